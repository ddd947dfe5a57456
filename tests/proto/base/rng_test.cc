#include "proto/base/rng.h"

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <set>
#include <vector>

namespace b4mrl {
namespace {

using Counter = std::array<uint32_t, 4>;

constexpr size_t kDraws = 200'000;

std::vector<double> Normals(Rng rng, size_t count) {
  std::vector<double> values(count);
  rng.FillNormal(std::span<double>(values));
  return values;
}

// Of two series with mean 0 and variance 1.
double Correlation(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum / static_cast<double>(a.size());
}

TEST_CASE("Philox gives the known answers of the Random123 distribution") {
  CHECK(Philox4x32({0, 0, 0, 0}, {0, 0}) ==
        Counter{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8});
  CHECK(Philox4x32({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}) ==
        Counter{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd});
  CHECK(Philox4x32({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}) ==
        Counter{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1});
}

TEST_CASE("draws are words of Philox blocks, numbered by position and stream") {
  const uint64_t key = MixSeeds(12, HashName("test"));
  const std::array<uint32_t, 2> key_words = {static_cast<uint32_t>(key),
                                             static_cast<uint32_t>(key >> 32)};
  Rng rng(12, "test", (uint64_t{7} << 32) | 5);
  rng.Seek((uint64_t{3} << 33) | 9);  // block (3 << 32) | 4, second half
  const Counter block = Philox4x32({4, 3, 5, 7}, key_words);
  CHECK(rng.NextUint64() == (block[2] | uint64_t{block[3]} << 32));
}

TEST_CASE("any position can be drawn directly, in any order") {
  Rng forward(1, "noise");
  std::vector<uint64_t> draws(101);
  for (uint64_t& draw : draws) draw = forward.NextUint64();
  CHECK(forward.position() == 101);
  Rng backward(1, "noise");
  for (size_t i = draws.size(); i-- > 0;) {
    backward.Seek(i);
    CHECK(backward.NextUint64() == draws[i]);
  }
  Rng copy = forward;
  CHECK(copy.NextUint64() == forward.NextUint64());
}

TEST_CASE("seed, purpose and stream each make another sequence") {
  const std::set<uint64_t> firsts = {Rng(1, "reset").NextUint64(), Rng(2, "reset").NextUint64(),
                                     Rng(1, "noise").NextUint64(), Rng(1, "reset", 1).NextUint64(),
                                     Rng(0, "reset").NextUint64(), Rng(~0ull, "").NextUint64()};
  CHECK(firsts.size() == 6);
}

TEST_CASE("uniform draws fill [0, 1) evenly") {
  constexpr size_t kCells = 100;
  std::vector<size_t> counts(kCells);
  Rng rng(3, "uniform");
  for (size_t i = 0; i < kDraws; ++i) {
    const double u = rng.Uniform();
    REQUIRE((u >= 0 && u < 1));
    ++counts[static_cast<size_t>(u * kCells)];
  }
  double chi_square = 0;
  constexpr double kExpected = static_cast<double>(kDraws) / kCells;
  for (const size_t count : counts) {
    chi_square += std::pow(static_cast<double>(count) - kExpected, 2) / kExpected;
  }
  // 99 degrees of freedom: mean 99, standard deviation 14; six of those either way.
  CHECK(chi_square < 99 + 6 * 14);
  CHECK(chi_square > 99 - 6 * 14);
}

TEST_CASE("normal draws have the moments of a standard normal") {
  Rng rng(4, "normal");
  double sum = 0, squares = 0, cubes = 0, fourths = 0;
  double beyond_three = 0;
  for (size_t i = 0; i < kDraws; ++i) {
    const double x = rng.Normal();
    sum += x;
    squares += x * x;
    cubes += x * x * x;
    fourths += x * x * x * x;
    beyond_three += std::abs(x) > 3 ? 1 : 0;
  }
  CHECK(rng.position() == kDraws);  // one draw each
  // Six standard errors: those of x^k have variances 1, 2, 15 and 96.
  const double n = kDraws;
  CHECK(std::abs(sum / n) < 6 * std::sqrt(1 / n));
  CHECK(std::abs(squares / n - 1) < 6 * std::sqrt(2 / n));
  CHECK(std::abs(cubes / n) < 6 * std::sqrt(15 / n));
  CHECK(std::abs(fourths / n - 3) < 6 * std::sqrt(96 / n));
  const double p = 0.0026997960632602;  // 2 (1 - Phi(3))
  CHECK(std::abs(beyond_three / n - p) < 6 * std::sqrt(p * (1 - p) / n));
}

TEST_CASE("sequences of neighbouring seeds, purposes and streams are uncorrelated") {
  const std::vector<double> base = Normals(Rng(1, "reset", 0), kDraws);
  // Six standard errors: the product of two independent standard normals has variance 1.
  const double bound = 6 / std::sqrt(static_cast<double>(kDraws));
  REQUIRE(std::abs(Correlation(base, Normals(Rng(2, "reset", 0), kDraws))) < bound);
  REQUIRE(std::abs(Correlation(base, Normals(Rng(1, "policy", 0), kDraws))) < bound);
  REQUIRE(std::abs(Correlation(base, Normals(Rng(1, "reset", 1), kDraws))) < bound);
  for (const size_t lag : {1, 2, 3, 17}) {
    const std::vector<double> head(base.begin(), base.end() - static_cast<long>(lag));
    const std::vector<double> tail(base.begin() + static_cast<long>(lag), base.end());
    REQUIRE(std::abs(Correlation(head, tail)) < bound);
  }
}

TEST_CASE("bounded draws reach every value and no other") {
  Rng rng(6, "below");
  std::array<size_t, 7> counts{};
  for (size_t i = 0; i < 70'000; ++i) ++counts.at(rng.Below(7));
  for (const size_t count : counts) {
    // Binomial with mean 10,000 and standard deviation 93; six of those.
    CHECK(std::abs(static_cast<double>(count) - 10'000) < 6 * 93);
  }
  CHECK(rng.Below(1) == 0);
}

TEST_CASE("filled normals have the bits of normals drawn one by one") {
  Rng filled(8, "fill"), drawn(8, "fill");
  // Nothing, parts of blocks and more than one, from even and odd positions.
  for (const size_t count : {0, 1, 1, 127, 128, 129, 20'001}) {
    filled.Seek(filled.position() + 3);
    drawn.Seek(filled.position());
    std::vector<double> values(count);
    filled.FillNormal(values);
    for (const double value : values) REQUIRE(value == drawn.Normal());
    CHECK(filled.position() == drawn.position());
  }
}

TEST_CASE("filled floats are the rounded doubles") {
  Rng a(7, "fill");
  Rng b(7, "fill");
  std::array<float, 33> floats{};
  std::array<double, 33> doubles{};
  a.FillNormal(floats);
  b.FillNormal(doubles);
  for (size_t i = 0; i < floats.size(); ++i) CHECK(floats[i] == static_cast<float>(doubles[i]));
}

TEST_CASE("normal quantiles agree with known ones") {
  struct Known {
    double p, x;
  };
  // The first three are the check values of AS 241; the others are standard table entries.
  for (const auto& [p, x] :
       {Known{0.25, -0.6744897501960817}, Known{0.001, -3.090232306167814},
        Known{1e-20, -9.262340089798408}, Known{0.5, 0.0}, Known{0.9, 1.2815515655446004},
        Known{0.975, 1.959963984540054}, Known{0.99, 2.3263478740408408}}) {
    // A few units in the last place: the paper's bound is 1e-16 before our own rounding.
    CHECK(NormalQuantile(p) == Approx(x).epsilon(4e-15).margin(1e-16));
  }
}

TEST_CASE("normal quantiles invert the distribution function to the last digits") {
  // erfc loses relative accuracy x^2 times over in the tails, where it stands for p.
  for (double exponent = -300; exponent < -0.31; exponent += 0.37) {
    const double p = std::pow(10, exponent);
    const double x = NormalQuantile(p);
    const double back = 0.5 * std::erfc(-x / std::sqrt(2.0));
    CAPTURE(p, x);
    REQUIRE(std::abs(back / p - 1) < 2e-15 * (2 + x * x));
  }
}

TEST_CASE("normal quantiles are odd about one half and increase") {
  double last = -100;
  for (int i = 1; i < 2000; ++i) {
    // Multiples of 2^-11 and their complements are exact.
    const double p = i * 0x1p-11;
    const double x = NormalQuantile(p);
    REQUIRE(x > last);
    REQUIRE(NormalQuantile(1 - p) == -x);
    last = x;
  }
}

TEST_CASE("the most extreme draws are finite") {
  const double lowest = NormalQuantile(OpenUniform(0));
  const double highest = NormalQuantile(OpenUniform(UINT64_MAX));
  // 2^-54 and 1 - 2^-53 lie 8.29 and 8.21 standard deviations out.
  CHECK(lowest == Approx(-8.29).margin(0.01));
  CHECK(highest == Approx(8.21).margin(0.01));
}

}  // namespace
}  // namespace b4mrl

#include "proto/base/rng.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <set>
#include <vector>

namespace b4mrl {
namespace {

constexpr size_t kDraws = 200'000;
// A deviation of five standard errors happens by chance in one of two million tests, and the
// numbers are always the same ones.
constexpr double kSigmas = 5;

// ---- The inverse of the key's derivation, to reach the key of a published answer
// -----------------

uint64_t InverseOf(uint64_t odd) {
  uint64_t inverse = odd;  // right in 3 bits; every round doubles them
  for (int i = 0; i < 6; ++i) inverse *= 2 - odd * inverse;
  return inverse;
}

uint64_t UndoXorShift(uint64_t z, int shift) {
  uint64_t result = z;
  for (int i = 0; i < 64 / shift; ++i) result = z ^ (result >> shift);
  return result;
}

uint64_t UndoFinalizer(uint64_t z) {
  z = UndoXorShift(z, 31) * InverseOf(0x94d049bb133111ebull);
  z = UndoXorShift(z, 27) * InverseOf(0xbf58476d1ce4e5b9ull);
  return UndoXorShift(z, 30);
}

// The seed with MixSeeds(seed, b) == key.
uint64_t SeedForKey(uint64_t key, uint64_t b) {
  constexpr uint64_t kGolden = 0x9e3779b97f4a7c15ull;
  return UndoFinalizer(UndoFinalizer(key) - b - kGolden) - kGolden;
}

std::vector<double> Normals(Rng rng, size_t count) {
  std::vector<double> values(count);
  rng.FillNormal(std::span<double>(values));
  return values;
}

double Mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double x : values) sum += x;
  return sum / static_cast<double>(values.size());
}

// Of two series with mean 0 and variance 1.
double Correlation(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum / static_cast<double>(a.size());
}

TEST_CASE("Key and counter zero give the answer that Random123 publishes for Philox-4x32-10") {
  constexpr char kPurpose[] = "known-answer";
  const uint64_t seed = SeedForKey(0, HashName(kPurpose));
  REQUIRE(MixSeeds(seed, HashName(kPurpose)) == 0);
  Rng rng(seed, kPurpose);
  // kat_vectors, "philox4x32 10" of zeros: 6627e8d5 e169c58d bc57ac4c 9b00dbd8, low words first.
  REQUIRE(rng.NextUint64() == 0xe169c58d6627e8d5ull);
  REQUIRE(rng.NextUint64() == 0x9b00dbd8bc57ac4cull);
}

TEST_CASE("Seek reaches every position in any order") {
  Rng straight(3, "test", 9);
  std::vector<uint64_t> draws;
  for (int i = 0; i < 100; ++i) draws.push_back(straight.NextUint64());
  REQUIRE(straight.position() == 100);
  Rng jumping(3, "test", 9);
  for (const uint64_t position : {99, 0, 1, 50, 51, 51, 50, 7, 98}) {
    jumping.Seek(position);
    REQUIRE(jumping.NextUint64() == draws[position]);
    REQUIRE(jumping.position() == position + 1);
  }
  jumping.Seek(uint64_t{1} << 40);
  REQUIRE(jumping.NextUint64() != draws[0]);
}

TEST_CASE("A copy continues on its own, and every kind of draw takes one position") {
  Rng rng(1, "test");
  rng.NextUint64();
  Rng copy = rng;
  REQUIRE(rng.NextUint64() == copy.NextUint64());
  rng.Uniform();
  rng.Normal();
  rng.Below(10);
  REQUIRE(rng.position() == 5);
  REQUIRE(copy.position() == 2);
}

TEST_CASE("Filling with normals equals drawing them one by one, rounded for floats") {
  Rng one(5, "test"), doubles(5, "test"), floats(5, "test");
  std::vector<double> d(33);
  std::vector<float> f(33);
  doubles.FillNormal(std::span<double>(d));
  floats.FillNormal(std::span<float>(f));
  for (size_t i = 0; i < d.size(); ++i) {
    const double x = one.Normal();
    REQUIRE(d[i] == x);
    REQUIRE(f[i] == static_cast<float>(x));
  }
}

TEST_CASE("Seed, purpose and stream each make another sequence") {
  std::set<uint64_t> first_draws;
  for (uint64_t seed = 0; seed < 50; ++seed) {
    for (const char* purpose : {"reset", "obs-noise", "policy"}) {
      for (uint64_t stream = 0; stream < 50; ++stream) {
        first_draws.insert(Rng(seed, purpose, stream).NextUint64());
      }
    }
  }
  REQUIRE(first_draws.size() == 50 * 3 * 50);
}

TEST_CASE("Sequences of neighbouring seeds, purposes and streams are uncorrelated") {
  const std::vector<double> base = Normals(Rng(1, "reset", 0), kDraws);
  const double bound = kSigmas / std::sqrt(static_cast<double>(kDraws));
  REQUIRE(std::abs(Correlation(base, Normals(Rng(2, "reset", 0), kDraws))) < bound);
  REQUIRE(std::abs(Correlation(base, Normals(Rng(1, "policy", 0), kDraws))) < bound);
  REQUIRE(std::abs(Correlation(base, Normals(Rng(1, "reset", 1), kDraws))) < bound);
  for (const size_t lag : {1, 2, 3, 17}) {
    const std::vector<double> head(base.begin(), base.end() - static_cast<long>(lag));
    const std::vector<double> tail(base.begin() + static_cast<long>(lag), base.end());
    REQUIRE(std::abs(Correlation(head, tail)) < bound);
  }
}

TEST_CASE("Normals have the moments and the tails of the normal distribution") {
  const std::vector<double> values = Normals(Rng(42, "moments"), kDraws);
  const double n = static_cast<double>(kDraws);
  std::vector<double> squares, cubes, fourths;
  size_t beyond_three = 0;
  for (const double x : values) {
    squares.push_back(x * x);
    cubes.push_back(x * x * x);
    fourths.push_back(x * x * x * x);
    beyond_three += std::abs(x) > 3;
  }
  // Variances of x, x^2, x^3 and x^4 are 1, 2, 15 and 96.
  REQUIRE(std::abs(Mean(values)) < kSigmas * std::sqrt(1 / n));
  REQUIRE(std::abs(Mean(squares) - 1) < kSigmas * std::sqrt(2 / n));
  REQUIRE(std::abs(Mean(cubes)) < kSigmas * std::sqrt(15 / n));
  REQUIRE(std::abs(Mean(fourths) - 3) < kSigmas * std::sqrt(96 / n));
  const double expected = std::erfc(3 / std::sqrt(2.0)) * n;
  REQUIRE(std::abs(static_cast<double>(beyond_three) - expected) < kSigmas * std::sqrt(expected));
}

TEST_CASE("Uniform draws fill their interval evenly and never leave it") {
  Rng rng(7, "uniform");
  constexpr int kBins = 20;
  std::vector<int> bins(kBins);
  for (size_t i = 0; i < kDraws; ++i) {
    const double x = rng.Uniform(-2, 3);
    REQUIRE(x >= -2);
    REQUIRE(x < 3);
    ++bins[static_cast<size_t>((x + 2) / 5 * kBins)];
  }
  const double expected = static_cast<double>(kDraws) / kBins;
  for (const int count : bins) {
    REQUIRE(std::abs(count - expected) < kSigmas * std::sqrt(expected));
  }
}

TEST_CASE("Below reaches every number under its bound about equally often") {
  Rng rng(8, "below");
  constexpr uint64_t kBound = 7;
  std::vector<int> counts(kBound);
  for (size_t i = 0; i < kDraws; ++i) ++counts.at(rng.Below(kBound));
  const double expected = static_cast<double>(kDraws) / kBound;
  for (const int count : counts) {
    REQUIRE(std::abs(count - expected) < kSigmas * std::sqrt(expected));
  }
  REQUIRE(rng.Below(1) == 0);
  REQUIRE(rng.Below(UINT64_MAX) < UINT64_MAX);
}

TEST_CASE("NormalQuantile inverts the distribution function to the last digits") {
  // erfc loses relative accuracy x^2 times over in the tails, where it stands for p.
  for (double exponent = -300; exponent < -0.31; exponent += 0.37) {
    const double p = std::pow(10, exponent);
    const double x = NormalQuantile(p);
    const double back = 0.5 * std::erfc(-x / std::sqrt(2.0));
    CAPTURE(p, x);
    REQUIRE(std::abs(back / p - 1) < 2e-15 * (2 + x * x));
  }
  REQUIRE(NormalQuantile(0.5) == 0);
  // Tables of the distribution; the last digit of a double may differ.
  REQUIRE(NormalQuantile(0.975) == Approx(1.959963984540054).epsilon(1e-15));
  REQUIRE(NormalQuantile(0.25) == Approx(-0.6744897501960817).epsilon(1e-15));
  REQUIRE(NormalQuantile(0.001) == Approx(-3.090232306167813).epsilon(1e-15));
  REQUIRE(NormalQuantile(1e-20) == Approx(-9.262340089798408).epsilon(1e-15));
}

TEST_CASE("NormalQuantile is odd about one half and increases") {
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

}  // namespace
}  // namespace b4mrl

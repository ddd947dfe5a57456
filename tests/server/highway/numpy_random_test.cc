#include "server/highway/numpy_random.h"

#include <catch2/catch.hpp>
#include <vector>

namespace b4mrl {
namespace {

TEST_CASE("PCG64 gives NumPy's numbers for seeds of one and two words") {
  // numpy.random.PCG64(seed).random_raw(3)
  struct Known {
    uint64_t seed;
    uint64_t draws[3];
  };
  const Known known[] = {
      {0, {0xa30febcfd9c2825f, 0x4510bdf882d9d721, 0x0a7d3da94ecde8b8}},
      {1, {0x8306bdf37922e4ff, 0xf35196bbc152a866, 0x24e7a4f608ec18cd}},
      {42, {0xc621fbcd16d92688, 0x705a5661a791ffc1, 0xdbcd12c26eda1624}},
      {0xffffffff, {0x407f5fa930d8fd9f, 0x3814b22eb9684802, 0x498b7dcee8d8dc95}},
      {0x100000000, {0xe3c5ebe285ac1625, 0x8ea09968fe31dbcc, 0xcd084ff84d8de9be}},
      {123456789012345678, {0x06eb45f8c176452d, 0xd0f84b1339cfaccc, 0x99f6a8be5cdc5ea2}},
      {0xffffffffffffffff, {0xae163a7a8c47568f, 0xd86659f5f3382359, 0x01e52b195bc2d24a}}};
  for (const auto& [seed, draws] : known) {
    INFO(seed);
    Pcg64 generator(seed);
    for (const uint64_t draw : draws) CHECK(generator.Next() == draw);
  }
}

TEST_CASE("Uniform and integer draws are those of numpy.random.default_rng") {
  // Three choice(3), uniform(21, 24), four choice(3), uniform(0.9, 1.1) from default_rng(7): the
  // kept half of a draw outlives the double between.
  NumpyRandom random(7);
  const auto below = [&random](int count) {
    std::vector<uint32_t> values;
    for (int i = 0; i < count; ++i) values.push_back(random.Below(3));
    return values;
  };
  CHECK(below(3) == std::vector<uint32_t>{2, 1, 2});
  CHECK(random.Uniform(21, 24) == 23.32705707073558);
  CHECK(below(4) == std::vector<uint32_t>{2, 2, 0, 0});
  CHECK(random.Uniform(0.9, 1.1) == 1.0747106890792524);
}

TEST_CASE("Integer draws reject as NumPy does") {
  // A bound of 3e9 rejects three draws in ten: default_rng(8).integers(3000000000), eight times.
  NumpyRandom random(8);
  for (const uint32_t expected : {980916829u, 2961830529u, 528098325u, 956132515u, 1919188835u,
                                  2609689534u, 144975446u, 1173254419u}) {
    CHECK(random.Below(3'000'000'000u) == expected);
  }
}

TEST_CASE("A jump is as good as drawing") {
  for (const uint64_t draws : {0ull, 1ull, 2ull, 63ull, 1000ull}) {
    Pcg64 walked(5), jumped(5);
    for (uint64_t i = 0; i < draws; ++i) walked.Next();
    jumped.Advance(draws);
    CHECK(walked.Next() == jumped.Next());
  }
}

TEST_CASE("Skipping resets gives the numbers that drawing them would have left") {
  for (const uint64_t lanes_per_reset : {0ull, 1ull, 4ull, 5ull}) {
    for (uint64_t resets = 0; resets < 5; ++resets) {
      NumpyRandom drawn(3), skipped(3);
      const uint64_t doubles_per_reset = 3 * lanes_per_reset + 1;
      for (uint64_t reset = 0; reset < resets; ++reset) {
        drawn.Uniform(0, 1);
        for (uint64_t i = 0; i < lanes_per_reset; ++i) {
          drawn.Below(3);
          for (int k = 0; k < 3; ++k) drawn.Uniform(0, 1);
        }
      }
      skipped.Skip(resets * doubles_per_reset, resets * lanes_per_reset, 3);
      for (int i = 0; i < 3; ++i) {
        CHECK(drawn.Below(3) == skipped.Below(3));
        CHECK(drawn.Uniform(0, 1) == skipped.Uniform(0, 1));
      }
    }
  }
}

}  // namespace
}  // namespace b4mrl

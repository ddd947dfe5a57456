#include "data/columns/sampler.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <numeric>
#include <utility>
#include <vector>

#include "data/columns/gather.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

std::vector<uint64_t> Sample(uint64_t seed, uint64_t batch, uint64_t rows, size_t count) {
  std::vector<uint64_t> out(count);
  SampleRows(seed, batch, rows, out);
  return out;
}

TEST_CASE("rows are a function of seed and batch number") {
  CHECK(Sample(1, 5, 1000, 256) == Sample(1, 5, 1000, 256));
  CHECK(Sample(1, 5, 1000, 256) != Sample(2, 5, 1000, 256));
  CHECK(Sample(1, 5, 1000, 256) != Sample(1, 6, 1000, 256));
  std::vector<uint64_t> shorter = Sample(1, 5, 1000, 256);
  shorter.resize(100);
  CHECK(Sample(1, 5, 1000, 100) == shorter);
}

TEST_CASE("rows are uniform with replacement") {
  std::vector<int> counts(10);
  constexpr int kBatches = 400;
  for (int batch = 0; batch < kBatches; ++batch) {
    for (const uint64_t row : Sample(3, batch, 10, 250)) {
      REQUIRE(row < 10);
      ++counts[row];
    }
  }
  // 100,000 draws over 10 rows: 10,000 each, standard deviation 95; six of them.
  for (const int count : counts) CHECK(std::abs(count - 10'000) < 570);
}

TEST_CASE("gathering copies exactly the named rows of every width") {
  Rng rng(4, "gather");
  for (const size_t row_bytes : {1u, 2u, 4u, 7u, 15u, 16u, 17u, 32u, 68u, 128u, 1504u}) {
    CAPTURE(row_bytes);
    constexpr size_t kRows = 50;
    std::vector<std::byte> source(kRows * row_bytes);
    for (std::byte& byte : source) byte = static_cast<std::byte>(rng.Below(256));
    for (const size_t count : {0u, 1u, 11u, 12u, 13u, 200u}) {
      std::vector<uint64_t> rows(count);
      for (uint64_t& row : rows) row = rng.Below(kRows);
      // One guard byte on either side.
      std::vector<std::byte> out(count * row_bytes + 2, std::byte{0xa5});
      const GatherColumn column = {source.data(), row_bytes, out.data() + 1};
      GatherRows(std::span(&column, 1), rows);
      CHECK(out.front() == std::byte{0xa5});
      CHECK(out.back() == std::byte{0xa5});
      bool equal = true;
      for (size_t i = 0; i < count; ++i) {
        equal &= std::memcmp(out.data() + 1 + i * row_bytes, source.data() + rows[i] * row_bytes,
                             row_bytes) == 0;
      }
      CHECK(equal);
    }
  }
}

TEST_CASE("gathering ends where it is told to, and can go on there") {
  std::vector<std::byte> source(100), out(100);
  for (size_t i = 0; i < source.size(); ++i) source[i] = static_cast<std::byte>(i);
  std::vector<uint64_t> rows(100);
  std::iota(rows.rbegin(), rows.rend(), 0);
  const std::vector<std::byte> reversed(source.rbegin(), source.rend());
  GatherColumn column = {source.data(), 1, out.data()};
  std::vector<size_t> pace = {0, 43, 20};
  const auto next = [&] { return std::exchange(pace, {pace.begin(), pace.end() - 1}).back(); };
  CHECK(GatherRows(std::span(&column, 1), rows, next) == 64);
  CHECK(pace.empty());
  CHECK(std::equal(out.begin(), out.begin() + 64, reversed.begin()));
  CHECK(std::count(out.begin() + 64, out.end(), std::byte{0}) == 36);
  column.destination += 64;
  CHECK(GatherRows(std::span(&column, 1), std::span(rows).subspan(64)) == 36);
  CHECK(out == reversed);
}

}  // namespace
}  // namespace b4mrl

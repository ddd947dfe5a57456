#include "algorithms/pictures/dataset_tally.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

namespace b4mrl {
namespace {

// Rows of one observation dimension and one action dimension.
struct Rows {
  std::vector<float> observations, actions, rewards;
  std::vector<uint8_t> terminals, timeouts;

  RowBlock Block(size_t first, size_t count) const {
    const auto part = [&](const auto& column) { return std::span(column).subspan(first, count); };
    return {part(observations), part(actions), part(rewards), part(terminals), part(timeouts)};
  }
  RowBlock All() const { return Block(0, rewards.size()); }
};

uint64_t Sum(const Histogram& histogram) {
  return std::accumulate(histogram.counts().begin(), histogram.counts().end(), uint64_t{0});
}

Rows SixRows() {
  return {.observations = {-2, -1, 0, 1, 2, 3},
          .actions = {-1, 1, -1, 1, -1, 1},
          .rewards = {1, 2, 4, 8, 16, 32},
          .terminals = {0, 1, 0, 0, 0, 0},
          .timeouts = {0, 0, 0, 1, 0, 0}};
}

TEST_CASE("Returns are those of complete episodes, whatever the blocks") {
  const Rows rows = SixRows();
  const size_t block = GENERATE(1, 2, 4, 6);
  CAPTURE(block);
  DatasetTally tally(1, 1);
  const auto each_block = [&](void (DatasetTally::*pass)(const RowBlock&)) {
    for (size_t first = 0; first < 6; first += block) {
      (tally.*pass)(rows.Block(first, std::min(block, 6 - first)));
    }
  };
  each_block(&DatasetTally::Measure);
  CHECK(tally.rows() == 6);
  CHECK(tally.returns().count() == 2);
  CHECK(tally.returns().low() == 3);
  CHECK(tally.returns().high() == 12);
  CHECK(tally.has_open_episode());
  tally.PrepareBins();
  each_block(&DatasetTally::Count);
  CHECK(Sum(tally.return_bins()) == 2);
  CHECK(tally.return_bins().counts().front() == 1);  // from 3 to 4
  CHECK(tally.return_bins().counts().back() == 1);   // from 11 to 12
  CHECK(Sum(tally.observation_bins()[0]) == 6);
  CHECK(tally.action_bins()[0].low() == -1);
  CHECK(tally.action_bins()[0].high() == 1);
  CHECK(tally.action_bins()[0].counts().front() == 3);
  CHECK(tally.action_bins()[0].counts().back() == 3);
}

TEST_CASE("Two datasets are counted in the same bins, which span the values of both") {
  Rows clean = SixRows(), corrupted = SixRows();
  corrupted.observations = {10, 10, 10, 10, 10, 10};
  DatasetTally a(1, 1), b(1, 1);
  a.Measure(clean.All());
  b.Measure(corrupted.All());
  a.PrepareBins(&b);
  b.PrepareBins(&a);
  CHECK(a.observation_bins()[0].low() == -2);
  CHECK(a.observation_bins()[0].high() == 10);
  CHECK(b.observation_bins()[0].low() == -2);
  CHECK(b.observation_bins()[0].high() == 10);
  CHECK(a.observation_bins()[0].counts().size() == b.observation_bins()[0].counts().size());
}

TEST_CASE("A reward that is NaN spoils the return of its own episode alone") {
  Rows rows = SixRows();
  rows.rewards[0] = std::numeric_limits<float>::quiet_NaN();
  DatasetTally tally(1, 1);
  tally.Measure(rows.All());
  CHECK(tally.returns().nans() == 1);
  CHECK(tally.returns().finite() == 1);
  CHECK(tally.returns().mean() == 12);
}

TEST_CASE("Bins are at most 80, of a round width, and hold every finite value") {
  Rows rows;
  const size_t count = 1000;
  for (size_t i = 0; i < count; ++i) {
    rows.observations.push_back(std::exp(0.01f * static_cast<float>(i)) - 3e3f);
    rows.actions.push_back(0.5f);
    rows.rewards.push_back(0.1f * static_cast<float>(i % 7));
    rows.terminals.push_back(1);
    rows.timeouts.push_back(0);
  }
  DatasetTally tally(1, 1);
  tally.Measure(rows.All());
  tally.PrepareBins();
  tally.Count(rows.All());
  CHECK_FALSE(tally.has_open_episode());
  for (const Histogram* bins :
       {&tally.observation_bins()[0], &tally.action_bins()[0], &tally.return_bins()}) {
    CHECK(bins->counts().size() >= 10);
    CHECK(bins->counts().size() <= 80);
    CHECK(Sum(*bins) == count);
  }
}

TEST_CASE("A dataset without rows has bins that stay empty") {
  DatasetTally tally(2, 1);
  tally.Measure({});
  tally.PrepareBins();
  tally.Count({});
  CHECK(tally.rows() == 0);
  CHECK(tally.returns().count() == 0);
  CHECK(tally.observation_bins().size() == 2);
  CHECK(Sum(tally.observation_bins()[1]) == 0);
  CHECK(Sum(tally.return_bins()) == 0);
}

}  // namespace
}  // namespace b4mrl

#include "data/columns/dataset.h"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>

#include "data/columns/dataset_builder.h"
#include "data/columns/episodes.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

TransitionColumns ColumnsOf(const ExampleDataset& data) {
  return {data.rows(),  data.observation_size,  data.action_size, data.observations, data.actions,
          data.rewards, data.next_observations, data.terminals,   data.timeouts};
}

TEST_CASE("statistics equal their definitions") {
  const TemporaryFolder folder;
  const ExampleDataset data = MakeExampleDataset({5, 7, 3});
  auto builder = DatasetBuilder::Create(folder.File("c"), 3, 2);
  REQUIRE(builder.ok());
  REQUIRE(builder->Append(ColumnsOf(data)).ok());
  REQUIRE(builder->Commit().ok());
  const auto dataset = Dataset::Open(folder.File("c"));
  REQUIRE(dataset.ok());
  const DatasetStatistics& statistics = (*dataset)->statistics();
  for (size_t i = 0; i < 3; ++i) {
    double mean = 0;
    for (size_t row = 0; row < 15; ++row) mean += data.observations[row * 3 + i] / 15.0;
    double variance = 0;
    for (size_t row = 0; row < 15; ++row) {
      variance += std::pow(data.observations[row * 3 + i] - mean, 2) / 15.0;
    }
    // Fifteen additions of doubles near 1 in another order.
    CHECK(statistics.observation_mean[i] == Approx(mean).epsilon(0).margin(1e-13));
    CHECK(statistics.observation_std[i] == Approx(std::sqrt(variance)).epsilon(1e-13));
  }
  CHECK(statistics.episodes == 3);
  std::array<double, 3> returns{};
  for (size_t row = 0; row < 15; ++row) {
    returns[row < 5 ? 0 : row < 12 ? 1 : 2] += static_cast<double>(data.rewards[row]);
  }
  const auto [lowest, highest] = std::ranges::minmax(returns);
  CHECK(statistics.min_return == lowest);
  CHECK(statistics.max_return == highest);
  const double mean = (returns[0] + returns[1] + returns[2]) / 3;
  CHECK(statistics.mean_return == Approx(mean).epsilon(1e-13));
  double variance = 0;
  for (const double each : returns) variance += std::pow(each - mean, 2) / 3;
  CHECK(statistics.std_return == Approx(std::sqrt(variance)).epsilon(1e-13));
  CHECK(statistics.min_reward == *std::min_element(data.rewards.begin(), data.rewards.end()));
  CHECK(statistics.max_reward == *std::max_element(data.rewards.begin(), data.rewards.end()));
}

TEST_CASE("an unfinished last episode counts as an episode but not as a return") {
  StatisticsAccumulator statistics(0);
  const float rewards[] = {1, 2, 100};
  const uint8_t terminals[] = {0, 1, 0};
  const uint8_t timeouts[] = {0, 0, 0};
  statistics.AddRewards(rewards, terminals, timeouts);
  const DatasetStatistics result = statistics.Finish();
  CHECK(result.episodes == 2);
  CHECK(result.mean_return == 3);
  CHECK(result.std_return == 0);
  CHECK(result.max_reward == 100);
}

TEST_CASE("NaN and infinity in data pass through the cache and mark the statistics") {
  const TemporaryFolder folder;
  ExampleDataset data = MakeExampleDataset({4});
  data.observations[4] = std::nanf("");
  data.observations[5] = INFINITY;
  data.rewards[1] = -INFINITY;
  auto builder = DatasetBuilder::Create(folder.File("c"), 3, 2);
  REQUIRE(builder->Append(ColumnsOf(data)).ok());
  REQUIRE(builder->Commit().ok());
  const auto dataset = Dataset::Open(folder.File("c"));
  REQUIRE(dataset.ok());
  CHECK(std::isnan((*dataset)->columns().observations[4]));
  CHECK(std::isinf((*dataset)->columns().observations[5]));
  CHECK(std::isfinite((*dataset)->statistics().observation_mean[0]));
  CHECK(std::isnan((*dataset)->statistics().observation_mean[1]));
  CHECK(std::isnan((*dataset)->statistics().observation_mean[2]));
  CHECK((*dataset)->statistics().mean_return == -INFINITY);
}

TEST_CASE("episodes end at terminals, time-outs and the end of the data") {
  const std::vector<uint8_t> terminals = {0, 1, 0, 0, 0, 0};
  const std::vector<uint8_t> timeouts = {0, 0, 0, 1, 0, 0};
  std::vector<uint64_t> last_rows;
  for (uint64_t row = 0; row < terminals.size(); ++row) {
    if (EndsEpisode(terminals, timeouts, row)) last_rows.push_back(row);
  }
  CHECK(last_rows == std::vector<uint64_t>{1, 3, 5});
}

TEST_CASE("missing time-outs are inferred from the step limit") {
  std::vector<uint8_t> terminals(7, 0);
  terminals[1] = 1;
  CHECK(InferTimeouts(terminals, 3) == std::vector<uint8_t>{0, 0, 0, 0, 1, 0, 0});
  terminals[4] = 1;  // a terminal at the limit stays one
  CHECK(InferTimeouts(terminals, 3) == std::vector<uint8_t>(7, 0));
}

TEST_CASE("the d4rl rule shifts observations, drops time-outs and the last row") {
  const TemporaryFolder folder;
  const ExampleDataset data = MakeExampleDataset({3, 2, 4});  // time-out, terminal, time-out
  const TransitionColumns all = ColumnsOf(data);
  for (const uint64_t step : {1u, 2u, 9u}) {
    CAPTURE(step);
    const std::string path = folder.File("c" + std::to_string(step));
    auto builder = DatasetBuilder::Create(path, 3, 2);
    for (uint64_t first = 0; first < all.rows; first += step) {
      const uint64_t rows = std::min(step, all.rows - first);
      TransitionColumns block = all;
      block.rows = rows;
      block.observations = all.observations.subspan(first * 3, rows * 3);
      block.actions = all.actions.subspan(first * 2, rows * 2);
      block.rewards = all.rewards.subspan(first, rows);
      const auto following = first + rows < all.rows
                                 ? all.observations.subspan((first + rows) * 3, 3)
                                 : std::span<const float>();
      REQUIRE(builder->AppendD4rl(block, first, data.terminals, data.timeouts, following).ok());
    }
    REQUIRE(builder->Commit().ok());
    const auto dataset = Dataset::Open(path);
    REQUIRE(dataset.ok());
    const TransitionColumns& kept = (*dataset)->columns();
    // Rows 2 (time-out) and 8 (time-out, and last) go; row 4 is terminal and stays.
    const std::vector<uint64_t> expected = {0, 1, 3, 4, 5, 6, 7};
    REQUIRE(kept.rows == expected.size());
    for (size_t i = 0; i < expected.size(); ++i) {
      CHECK(kept.rewards[i] == data.rewards[expected[i]]);
      CHECK(kept.observations[i * 3 + 1] == data.observations[expected[i] * 3 + 1]);
      CHECK(kept.next_observations[i * 3 + 2] == data.observations[(expected[i] + 1) * 3 + 2]);
    }
    CHECK(std::vector<uint8_t>(kept.terminals.begin(), kept.terminals.end()) ==
          std::vector<uint8_t>{0, 0, 0, 1, 0, 0, 0});
    CHECK(std::vector<uint8_t>(kept.timeouts.begin(), kept.timeouts.end()) ==
          std::vector<uint8_t>{0, 1, 0, 0, 0, 0, 1});
  }
}

TEST_CASE("transition rules have names") {
  CHECK(ParseTransitionRule("").value() == TransitionRule::kStored);
  CHECK(ParseTransitionRule("d4rl").value() == TransitionRule::kD4rl);
  CHECK(ParseTransitionRule("d4r1").status().code() == StatusCode::kUnknownName);
}

}  // namespace
}  // namespace b4mrl

#include "data/minari/episode_lengths.h"

#include <catch2/catch.hpp>

#include "tests/data/example_dataset.h"

namespace b4mrl {
namespace {

TEST_CASE("the lengths of episodes are found however the rows are split") {
  const ExampleDataset data = MakeExampleDataset({4, 1, 7});
  for (const size_t step : {1, 2, 5, 12}) {
    EpisodeLengths episodes;
    for (size_t first = 0; first < data.rows(); first += step) {
      REQUIRE(episodes.Append(data.Rows(first, std::min(step, data.rows() - first))).ok());
    }
    CHECK(episodes.lengths() == std::vector<uint64_t>{4, 1, 7});
    CHECK(episodes.rows() == 12);
    CHECK_FALSE(episodes.last_is_unfinished());
  }
}

TEST_CASE("a last episode without terminal and time-out is unfinished") {
  ExampleDataset data = MakeExampleDataset({4, 3});
  data.terminals.back() = 0;
  EpisodeLengths episodes;
  REQUIRE(episodes.Append(data.Rows()).ok());
  CHECK(episodes.lengths() == std::vector<uint64_t>{4, 3});
  CHECK(episodes.last_is_unfinished());
}

TEST_CASE("a row whose next observation is not the next row's observation is named") {
  ExampleDataset data = MakeExampleDataset({4, 3});
  data.next_observations[5 * data.observation_size + 1] += 1;  // row 5, inside the second episode
  for (const size_t step : {1, 7}) {
    EpisodeLengths episodes;
    Status status;
    for (size_t first = 0; first < data.rows() && status.ok(); first += step) {
      status = episodes.Append(data.Rows(first, step));
    }
    CHECK(status.code() == StatusCode::kFailedPrecondition);
    CHECK_THAT(status.message(), Catch::Contains("next observation of row 5"));
  }
}

}  // namespace
}  // namespace b4mrl

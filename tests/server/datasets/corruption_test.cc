#include "server/datasets/corruption.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>

#include "data/columns/row_blocks.h"
#include "server/datasets/dataset_environment.h"
#include "server/environments/list.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

constexpr uint32_t kSize = 17;
constexpr uint32_t kActions = 6;

TransitionColumns ColumnsOf(const ExampleDataset& data) {
  return {data.rows(),  data.observation_size,  data.action_size, data.observations, data.actions,
          data.rewards, data.next_observations, data.terminals,   data.timeouts};
}

struct Corrupted {
  std::shared_ptr<const Dataset> dataset;
  const TransitionColumns& columns() const { return dataset->columns(); }
};

Corrupted Corrupt(const ExampleDataset& data, const std::string& items, uint64_t seed,
                  uint64_t matrix = 1) {
  const TemporaryFolder folder;  // what is mapped outlives it
  const auto spec = SpecOfDataset("HalfCheetah/medium", "HalfCheetah", kSize, kActions);
  REQUIRE(spec.ok());
  const auto corruption = MakeCorruption(ParseNamedArguments(items).value(), *spec);
  INFO(corruption.status().ToString());
  REQUIRE(corruption.ok());
  auto builder = DatasetBuilder::Create(folder.File("c"), kSize, kActions);
  REQUIRE(AppendCorrupted(ColumnsOf(data), {corruption->set, seed, matrix}, false, &*builder).ok());
  REQUIRE(builder->Commit().ok());
  return {Dataset::Open(folder.File("c")).value()};
}

ExampleDataset HalfCheetahLike(const std::vector<size_t>& lengths) {
  return MakeExampleDataset(lengths, kSize, kActions);
}

TEST_CASE("inside an episode a state looks the same from both sides") {
  // Longer than a block of the corruption, so that its seams are crossed.
  const ExampleDataset data = HalfCheetahLike({20'000, 3, 14'000});
  const Corrupted noisy = Corrupt(data, "obs-noise=0.05", 3);
  const TransitionColumns& columns = noisy.columns();
  std::vector<uint64_t> differing;
  for (uint64_t row = 0; row + 1 < columns.rows; ++row) {
    const bool equal = std::memcmp(&columns.next_observations[row * kSize],
                                   &columns.observations[(row + 1) * kSize], kSize * 4) == 0;
    if (!equal) differing.push_back(row);
  }
  CHECK(differing == std::vector<uint64_t>{19'999, 20'002});  // the ends of the first two episodes
}

TEST_CASE("a block of wide rows is short, and its noise is that of its rows all the same") {
  constexpr uint32_t kWide = 4'096;
  const ExampleDataset data = MakeExampleDataset({300}, kWide, 1);
  REQUIRE(RowsAtOnce(ColumnsOf(data), 65'536) < 300);
  const auto spec = SpecOfDataset("Wide/w", "Wide", kWide, 1);
  REQUIRE(spec.ok());
  const auto corruption = MakeCorruption(ParseNamedArguments("obs-noise=1").value(), *spec);
  REQUIRE(corruption.ok());
  const TemporaryFolder folder;
  auto builder = DatasetBuilder::Create(folder.File("c"), kWide, 1);
  REQUIRE(AppendCorrupted(ColumnsOf(data), {corruption->set, 3, 1}, false, &*builder).ok());
  REQUIRE(builder->Commit().ok());
  const auto noisy = Dataset::Open(folder.File("c"));
  REQUIRE(noisy.ok());
  const auto next = (*noisy)->columns().next_observations.first(299 * kWide);
  CHECK(std::ranges::equal(next, (*noisy)->columns().observations.subspan(kWide)));
}

TEST_CASE("an episode's last next observation has noise of its own") {
  const ExampleDataset data = HalfCheetahLike({4, 4});
  const Corrupted noisy = Corrupt(data, "obs-noise=1", 3);
  const TransitionColumns& columns = noisy.columns();
  for (const size_t row : {3u, 7u}) {
    for (size_t i = 0; i < kSize; ++i) {
      const float last =
          columns.next_observations[row * kSize + i] - data.next_observations[row * kSize + i];
      CHECK(last != 0);
      for (size_t other = 0; other < 8; ++other) {
        const float noise =
            columns.observations[other * kSize + i] - data.observations[other * kSize + i];
        // Two float32 roundings near 1.
        CHECK(std::abs(last - noise) > 1e-6f);
      }
    }
  }
}

TEST_CASE("a last row whose next observation is the next row's has that one's noise") {
  // As D4RL's rule reads a file without next observations; longer than a block of the corruption.
  ExampleDataset data = HalfCheetahLike({4, 16'380, 4});
  for (const size_t row : {3u, 16'383u}) {
    std::copy_n(&data.observations[(row + 1) * kSize], kSize, &data.next_observations[row * kSize]);
  }
  const Corrupted noisy = Corrupt(data, "obs-noise=1", 3);
  const TransitionColumns& columns = noisy.columns();
  for (const size_t row : {3u, 16'383u}) {
    CAPTURE(row);
    const auto next = columns.next_observations.subspan(row * kSize, kSize);
    CHECK(std::ranges::equal(next, columns.observations.subspan((row + 1) * kSize, kSize)));
  }
}

TEST_CASE("levels scale one matrix, which is standard normal") {
  const ExampleDataset data = HalfCheetahLike({10'000});
  const Corrupted low = Corrupt(data, "obs-noise-low", 9);
  const Corrupted high = Corrupt(data, "obs-noise-high", 9);
  double sum = 0;
  double squares = 0;
  const size_t count = data.observations.size();
  for (size_t i = 0; i < count; ++i) {
    const double small = double{low.columns().observations[i]} - data.observations[i];
    const double large = double{high.columns().observations[i]} - data.observations[i];
    // Rounding of numbers up to 8 to float32, five times enlarged.
    if (std::abs(large - 5 * small) > 5e-6) FAIL("not the same matrix at " << i);
    sum += small / 0.01;
    squares += small * small / 1e-4;
  }
  // 170,000 draws: the mean's standard error is 0.0024, the variance's 0.0034; five of them.
  CHECK(std::abs(sum / count) < 0.012);
  CHECK(std::abs(squares / count - 1) < 0.017);
}

TEST_CASE("noise is a function of the seed and of the matrix") {
  const ExampleDataset data = HalfCheetahLike({50});
  const auto observations = [&](uint64_t seed, uint64_t matrix) {
    const Corrupted noisy = Corrupt(data, "obs-noise=0.1", seed, matrix);
    return std::vector<float>(noisy.columns().observations.begin(),
                              noisy.columns().observations.end());
  };
  CHECK(observations(1, 1) == observations(1, 1));
  CHECK(observations(1, 1) != observations(2, 1));
  CHECK(observations(1, 1) != observations(1, 2));
}

TEST_CASE("hidden dimensions are zero in both columns and everything else is untouched") {
  ExampleDataset data = HalfCheetahLike({5, 6});
  data.observations[20] = std::nanf("1");
  data.next_observations[21] = -INFINITY;
  const Corrupted hidden = Corrupt(data, "hidden=9+16", 0);
  const TransitionColumns& columns = hidden.columns();
  for (size_t row = 0; row < 11; ++row) {
    for (size_t i = 0; i < kSize; ++i) {
      const size_t at = row * kSize + i;
      const float wanted = i == 9 || i == 16 ? 0.0f : data.observations[at];
      CHECK(std::memcmp(&columns.observations[at], &wanted, 4) == 0);
      const float next = i == 9 || i == 16 ? 0.0f : data.next_observations[at];
      CHECK(std::memcmp(&columns.next_observations[at], &next, 4) == 0);
    }
  }
  CHECK(std::memcmp(columns.rewards.data(), data.rewards.data(), 44) == 0);
  CHECK(std::memcmp(columns.actions.data(), data.actions.data(), 11 * kActions * 4) == 0);
  CHECK(hidden.dataset->statistics().observation_std[9] == 0);
}

TEST_CASE("noise passes NaN and infinity") {
  ExampleDataset data = HalfCheetahLike({3});
  data.observations[0] = std::nanf("");
  data.observations[1] = INFINITY;
  const Corrupted noisy = Corrupt(data, "obs-noise=0.1", 1);
  CHECK(std::isnan(noisy.columns().observations[0]));
  CHECK(std::isinf(noisy.columns().observations[1]));
  CHECK(std::isfinite(noisy.columns().observations[2]));
}

TEST_CASE("presets resolve, names work, and what cannot corrupt data is refused") {
  const EnvironmentSpec spec =
      SpecOfDataset("d4rl/halfcheetah-medium-v2", "HalfCheetah", 17, 6).value();
  const auto resolve = [&](const std::string& items) {
    return MakeCorruption(ParseNamedArguments(items).value(), spec);
  };
  CHECK(FormatNamedArguments(resolve("hidden-high,obs-noise-low")->set.items()) ==
        "obs-noise=0.01,hidden=9");
  CHECK(resolve("hidden-high")->hidden_dimensions == std::vector<uint32_t>{9});
  CHECK(resolve("hidden=" + spec.observation.dimensions[9].name)->set.items() ==
        resolve("hidden=9")->set.items());
  CHECK(resolve("gravity=2").status().code() == StatusCode::kUnsupported);
  CHECK(resolve("hidden=17").status().code() == StatusCode::kInvalidArgument);
  CHECK(resolve("obs-noise=-1").status().code() == StatusCode::kInvalidArgument);
  CHECK(resolve("obs-noize=1").status().code() == StatusCode::kUnknownName);
}

TEST_CASE("the seed matters to exactly those corruptions that say that they draw numbers") {
  const ExampleDataset data = HalfCheetahLike({20});
  const auto observations = [&](const std::string& items, uint64_t seed) {
    const Corrupted corrupted = Corrupt(data, items, seed);
    const auto values = corrupted.columns().observations;
    return std::vector<float>(values.begin(), values.end());
  };
  size_t corruptions = 0;
  for (const PerturbationEntry& entry : PerturbationList()) {
    if (!entry.corrupts_datasets) continue;
    ++corruptions;
    const std::string item = std::string(entry.name) + "=1";
    CAPTURE(item);
    const bool differs = observations(item, 1) != observations(item, 2);
    CHECK(differs == entry.draws_for_datasets);
    const EnvironmentSpec spec = SpecOfDataset("x", "HalfCheetah", kSize, kActions).value();
    CHECK(MakeCorruption(ParseNamedArguments(item).value(), spec)->draws == differs);
  }
  CHECK(corruptions >= 2);
}

TEST_CASE("datasets of unknown environments have unnamed dimensions") {
  for (const char* environment : {"", "Swimmer"}) {
    const EnvironmentSpec spec = SpecOfDataset("Mine/first", environment, 2, 1).value();
    CHECK(MakeCorruption({{"hidden", "1"}}, spec)->hidden_dimensions == std::vector<uint32_t>{1});
  }
  CHECK(SpecOfDataset("HalfCheetah/medium", "HalfCheetah", 2, 1).status().code() ==
        StatusCode::kFailedPrecondition);
}

TEST_CASE("a dataset belongs to the environment that its folder or its D4RL name says") {
  CHECK(EnvironmentOfName("HalfCheetah/medium") == "HalfCheetah");
  CHECK(EnvironmentOfName("d4rl/halfcheetah-medium-v2") == "HalfCheetah");
  CHECK(EnvironmentOfName("halfcheetah/medium").empty());
  CHECK(EnvironmentOfName("Mine/first").empty());
}

}  // namespace
}  // namespace b4mrl

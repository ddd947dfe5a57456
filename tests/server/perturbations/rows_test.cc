// Observations with rows (Highway's vehicles): features name columns, noise leaves flags and empty
// rows alone.
#include <nlohmann/json.hpp>

#include "server/environments/list.h"
#include "server/perturbations/list.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

constexpr size_t kRows = 5;
constexpr size_t kColumns = 5;  // presence, x, y, vx, vy

EnvironmentSpec Spec() { return Take(DescribeEnvironment("Highway")); }

PerturbationSet Make(const std::string& text) {
  return Take(
      MakePerturbations(Take(ParseNamedArguments(text)), Spec(), PerturbationUse::kSimulator));
}

std::vector<uint32_t> Hidden(const std::string& text) {
  return Take(HiddenDimensions(Take(ParseNamedArguments(text)), Spec()));
}

// Three cars and two rows that are empty.
std::vector<double> Observation() {
  std::vector<double> observation(kRows * kColumns, 0.0);
  for (size_t row = 0; row < 3; ++row) {
    observation[row * kColumns] = 1;
    for (size_t column = 1; column < kColumns; ++column) {
      observation[row * kColumns + column] = 0.1 * static_cast<double>(row + column);
    }
  }
  return observation;
}

TEST_CASE("A feature names its column of every row, an index or a name one number") {
  REQUIRE(Spec().observation.shape == std::vector<uint64_t>{kRows, kColumns});
  CHECK(Hidden("hidden-low") == std::vector<uint32_t>{3, 4, 8, 9, 13, 14, 18, 19, 23, 24});
  CHECK(Hidden("hidden-high") == Hidden("hidden=y+vx+vy"));
  CHECK(Hidden("hidden-high").size() == 3 * kRows);
  CHECK(Hidden("hidden=7") == std::vector<uint32_t>{7});
  CHECK(Hidden("hidden=" + Spec().observation.dimensions[7].name) == std::vector<uint32_t>{7});
  CHECK(Hidden("hidden=7+y") == std::vector<uint32_t>{2, 7, 12, 17, 22});
  const auto unknown = MakePerturbations(Take(ParseNamedArguments("hidden=vz")), Spec(),
                                         PerturbationUse::kSimulator);
  REQUIRE(unknown.status().code() == StatusCode::kUnknownName);
  CHECK(unknown.status().message().find("vx") != std::string::npos);
}

TEST_CASE("Hidden features are 0 in every row of what a lane observes") {
  TestLane clean(Take(TryOpen("Highway")));
  TestLane hidden(Take(TryOpen("Highway", "hidden-high")));
  clean.Reset(3);
  hidden.Reset(3);
  for (uint64_t k = 0; k < 10; ++k) {
    std::vector<double> expected = clean.observation();
    for (size_t row = 0; row < kRows; ++row) {
      for (const size_t column : {2, 3, 4}) expected[row * kColumns + column] = 0;
    }
    REQUIRE(hidden.observation() == expected);
    clean.StepRandomly(k);
    hidden.StepRandomly(k);
  }
}

TEST_CASE("Noise spares presence and rows that are empty, and keeps every place in the stream") {
  const std::vector<double> before = Observation();
  const DrawContext context = {DrawContext::Kind::kEpisode, 1, 2, 3};
  std::vector<double> after = before;
  Make("obs-noise=0.5").OnObservation(context, {}, after);
  std::vector<double> full = before;
  for (size_t row = 3; row < kRows; ++row) full[row * kColumns] = 1;  // two more cars
  std::vector<double> noisy_full = full;
  Make("obs-noise=0.5").OnObservation(context, {}, noisy_full);
  for (size_t i = 0; i < before.size(); ++i) {
    const bool untouched = i % kColumns == 0 || i >= 3 * kColumns;
    INFO("dimension " << i);
    CHECK((after[i] == before[i]) == untouched);
    CHECK((noisy_full[i] == full[i]) == (i % kColumns == 0));
    // The noise of a car does not depend on how many cars there are.
    if (!untouched) CHECK(noisy_full[i] == after[i]);
  }
}

TEST_CASE("Noise finds the empty rows even though presence is hidden") {
  std::vector<double> observation = Observation();
  Make("hidden=presence,obs-noise=0.5").OnObservation({}, {}, observation);
  const std::vector<double> before = Observation();
  for (size_t i = 0; i < observation.size(); ++i) {
    if (i % kColumns == 0 || i >= 3 * kColumns) {
      CHECK(observation[i] == 0);
    } else {
      CHECK(observation[i] != before[i]);
    }
  }
}

}  // namespace
}  // namespace b4mrl

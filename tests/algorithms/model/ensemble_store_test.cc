#include "algorithms/model/ensemble_store.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "algorithms/base/learner.h"
#include "proto/base/rng.h"
#include "tests/algorithms/core_state.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

constexpr int kObservations = 3;
constexpr int kActions = 2;

// Random rows: nothing to learn, but a function of the seed.
struct Rows {
  explicit Rows(int count = 300, uint64_t seed = 0)
      : observations(kObservations, count),
        actions(kActions, count),
        targets(kObservations + 1, count) {
    Rng rng(seed, "ensemble-training-test");
    for (MatrixBuffer<float>* part : {&observations, &actions, &targets}) {
      rng.FillNormal(part->values());
    }
  }
  DynamicsData<float> view() const { return {observations.view(), actions.view(), targets.view()}; }

  MatrixBuffer<float> observations, actions, targets;
};

DynamicsEnsembleOptions Small() {
  DynamicsEnsembleOptions options;
  options.observation_size = kObservations;
  options.action_size = kActions;
  options.members = 3;
  options.elites = 2;
  options.hidden = {8, 8, 8, 8};
  options.batch_size = 16;
  options.max_updates = 60;
  return options;
}

struct Trained {
  std::string key;
  CoreState<float> state;
  double seconds_before;
};

Trained TrainIn(const EnsembleFiles& files, const Rows& rows,
                const DynamicsEnsembleOptions& options = Small(), bool stop = false,
                int threads = 1) {
  fs::create_directories(files.run_folder);
  Result<DynamicsEnsemble<float>> ensemble = DynamicsEnsemble<float>::Create(options, threads);
  REQUIRE(ensemble.ok());
  Progress quiet(true);
  const Result<EnsembleTraining> training =
      TrainEnsemble(rows.view(), files, *ensemble, quiet, std::atomic<bool>(stop));
  INFO(training.status().ToString());
  REQUIRE(training.ok());
  CHECK(ensemble->trained() == !stop);
  return {training->key, SaveState<float>(*ensemble), training->seconds_before};
}

EnsembleFiles FilesIn(const TemporaryFolder& folder, const std::string& run) {
  return {.run_folder = folder.File(run), .cache_folder = folder.File("cache")};
}

std::string CacheFile(const TemporaryFolder& folder, const std::string& key) {
  return folder.File("cache/ensembles/" + key + ".h5");
}

}  // namespace

TEST_CASE("An ensemble taken from the cache has the bits of one that was trained") {
  TemporaryFolder folder;
  const Rows rows;
  const Trained first = TrainIn(FilesIn(folder, "first"), rows);
  const std::string cached = CacheFile(folder, first.key);
  REQUIRE(fs::exists(cached));
  const auto long_ago = fs::last_write_time(cached) - std::chrono::hours(100);
  fs::last_write_time(cached, long_ago);

  const Trained second = TrainIn(FilesIn(folder, "second"), rows);
  CHECK(second.key == first.key);
  CHECK(second.state == first.state);
  CHECK(fs::last_write_time(cached) > long_ago);  // it was used

  EnsembleFiles without = FilesIn(folder, "third");
  without.cache_folder.clear();
  CHECK(TrainIn(without, rows).state == first.state);
}

TEST_CASE("Whatever an ensemble depends on gives it another key") {
  TemporaryFolder folder;
  const Rows rows;
  const std::string key = TrainIn(FilesIn(folder, "run"), rows).key;
  DynamicsEnsembleOptions options = Small();
  Rows other;
  SECTION("the seed") { options.seed = 1; }
  SECTION("an option that shows late") { options.patience_epochs = 4; }
  SECTION("how many members rollouts use") { options.elites = 1; }
  SECTION("the decay factor") { options.decay_scale = 0.5; }
  SECTION("the precision") {
    if (!HasBf16()) {
      WARN("skipped: this processor has no AVX512-BF16");
      return;
    }
    options.precision = Precision::kBf16;
  }
  SECTION("an observation") { other.observations.view()(0, 299) += 1e-6f; }
  SECTION("an action") { other.actions.view()(0, 299) += 1e-6f; }
  SECTION("a target") { other.targets.view()(3, 299) += 1e-6f; }
  SECTION("the number of rows") { other = Rows(299); }
  CHECK(TrainIn(FilesIn(folder, "other"), other, options).key != key);
}

TEST_CASE("An ensemble that was told to stop goes on with the bits of one that was not") {
  TemporaryFolder folder;
  const Rows rows;
  EnsembleFiles files = FilesIn(folder, "halves");
  const Trained half = TrainIn(files, rows, Small(), /*stop=*/true);
  CHECK_FALSE(fs::exists(CacheFile(folder, half.key)));
  const Trained whole = TrainIn(files, rows);
  CHECK(whole.key == half.key);
  files = {.run_folder = folder.File("straight"), .cache_folder = ""};
  CHECK(whole.state == TrainIn(files, rows).state);
}

TEST_CASE("The seconds that a run spent on its ensemble add up, and those of other runs do not") {
  TemporaryFolder folder;
  const Rows rows;
  const EnsembleFiles files = FilesIn(folder, "run");
  const Trained first = TrainIn(files, rows, Small(), /*stop=*/true);
  CHECK(first.seconds_before == 0);
  const Trained second = TrainIn(files, rows);
  CHECK(second.seconds_before > 0);
  CHECK(TrainIn(files, rows).seconds_before > second.seconds_before);  // trained, no checkpoint yet
  CHECK(TrainIn(FilesIn(folder, "other"), rows).seconds_before == 0);  // from the cache
}

TEST_CASE("A run goes on with an ensemble of another kind of processor and keeps it to itself") {
  TemporaryFolder folder;
  const Rows rows;
  const EnsembleFiles files = FilesIn(folder, "run");
  const bool halfway = GENERATE(true, false);
  const Trained before = TrainIn(files, rows, Small(), /*stop=*/halfway);
  fs::remove(CacheFile(folder, before.key));
  // As another processor's first update would have named it.
  const std::string elsewhere(before.key.size(), '0');
  std::string bytes = ReadBytes(files.run_folder + "/ensemble.h5");
  const size_t at = bytes.find(before.key);
  REQUIRE(at != std::string::npos);
  WriteBytes(files.run_folder + "/ensemble.h5", bytes.replace(at, elsewhere.size(), elsewhere));

  const Trained after = TrainIn(files, rows);
  CHECK(after.key != before.key);
  CHECK((after.key == elsewhere) == !halfway);  // one that is trained stays what it was
  CHECK_FALSE(fs::exists(CacheFile(folder, before.key)));
  CHECK_FALSE(fs::exists(CacheFile(folder, after.key)));
  Result<DynamicsEnsemble<float>> ensemble = DynamicsEnsemble<float>::Create(Small());
  REQUIRE(ensemble.ok());
  CHECK(LoadTrainedEnsemble(after.key, files, *ensemble).ok());

  Rows other;
  other.targets.view()(0, 0) += 1e-6f;
  const std::string anew = TrainIn(FilesIn(folder, "other"), other).key;
  CHECK(TrainIn(files, other).key == anew);  // other data's ensemble is not taken up
}

TEST_CASE("Threads change no bit of an ensemble and of its key") {
  TemporaryFolder folder;
  const Rows rows;
  DynamicsEnsembleOptions options = Small();
  options.bootstrap = GENERATE(false, true);
  const Trained alone = TrainIn({folder.File("alone"), ""}, rows, options);
  const Trained team = TrainIn({folder.File("team"), ""}, rows, options, /*stop=*/false, 2);
  CHECK(team.key == alone.key);
  CHECK(team.state == alone.state);
}

TEST_CASE("A damaged file is trained anew") {
  TemporaryFolder folder;
  const Rows rows;
  const Trained first = TrainIn(FilesIn(folder, "first"), rows);
  const std::string cached = CacheFile(folder, first.key);
  std::string bytes = ReadBytes(cached);
  SECTION("cut short") { bytes.resize(bytes.size() / 2); }
  SECTION("one bit flipped in the best weights") {
    Result<DynamicsEnsemble<float>> ensemble = DynamicsEnsemble<float>::Create(Small());
    REQUIRE(ensemble.ok());
    REQUIRE(LoadTrainedEnsemble(first.key, FilesIn(folder, "first"), *ensemble).ok());
    std::string weights;
    ensemble->VisitArrays([&](const NamedArray<float>& array) {
      if (array.name != "best_ensemble/layer0/weight") return;
      weights.assign(reinterpret_cast<const char*>(array.values.data()), array.values.size_bytes());
    });
    const size_t at = bytes.find(weights);
    REQUIRE(at != std::string::npos);
    bytes[at] = static_cast<char>(bytes[at] ^ 1);
  }
  WriteBytes(cached, bytes);
  CHECK(TrainIn(FilesIn(folder, "second"), rows).state == first.state);
  // Its successor is kept in its place.
  Result<DynamicsEnsemble<float>> kept = DynamicsEnsemble<float>::Create(Small());
  REQUIRE(kept.ok());
  CHECK(LoadTrainedEnsemble(first.key, FilesIn(folder, "third"), *kept).ok());
}

TEST_CASE("A resumed run finds its ensemble in its folder, or else in the cache") {
  TemporaryFolder folder;
  const Rows rows;
  const EnsembleFiles files = FilesIn(folder, "run");
  const Trained trained = TrainIn(files, rows);
  Result<DynamicsEnsemble<float>> ensemble = DynamicsEnsemble<float>::Create(Small());
  REQUIRE(ensemble.ok());
  SECTION("in its folder") { fs::remove(CacheFile(folder, trained.key)); }
  SECTION("in the cache") { fs::remove(files.run_folder + "/ensemble.h5"); }
  REQUIRE(LoadTrainedEnsemble(trained.key, files, *ensemble).ok());
  CHECK(SaveState<float>(*ensemble) == trained.state);
  CHECK(LoadTrainedEnsemble("another", files, *ensemble).code() == StatusCode::kDataLoss);
}

TEST_CASE("A full cache lets the longest unused ensembles go") {
  TemporaryFolder folder;
  const Rows rows;
  EnsembleFiles files = FilesIn(folder, "run");
  std::vector<std::string> cached;
  for (uint64_t seed = 0; seed < 3; ++seed) {
    DynamicsEnsembleOptions options = Small();
    options.seed = seed;
    cached.push_back(CacheFile(folder, TrainIn(files, rows, options).key));
    REQUIRE(fs::exists(cached.back()));
    // The first one was used last.
    const auto age = std::chrono::hours(seed == 0 ? 1 : 10 - seed);
    fs::last_write_time(cached.back(), fs::file_time_type::clock::now() - age);
    files.cache_bytes_max = 2 * fs::file_size(cached[0]) + 100;  // room for two
  }
  CHECK(fs::exists(cached[0]));
  CHECK_FALSE(fs::exists(cached[1]));
  CHECK(fs::exists(cached[2]));
}

TEST_CASE("An ensemble for which the whole cache has no room is not kept, and removes no other") {
  TemporaryFolder folder;
  const Rows rows;
  EnsembleFiles files = FilesIn(folder, "run");
  const std::string small = CacheFile(folder, TrainIn(files, rows).key);
  REQUIRE(fs::exists(small));
  files.cache_bytes_max = fs::file_size(small) + 100;
  DynamicsEnsembleOptions options = Small();
  options.hidden = {64, 64, 64, 64};
  const std::string large = CacheFile(folder, TrainIn(files, rows, options).key);
  CHECK_FALSE(fs::exists(large));
  CHECK(fs::exists(small));
}

TEST_CASE("An ensemble whose hold-out errors all overflow fails instead of staying untrained") {
  TemporaryFolder folder;
  Rows rows;
  rows.targets.view()(0, 299) = 1e30f;  // held out; its square is no float
  Result<DynamicsEnsemble<float>> ensemble = DynamicsEnsemble<float>::Create(Small());
  REQUIRE(ensemble.ok());
  Progress quiet(true);
  const EnsembleFiles files = FilesIn(folder, "run");
  fs::create_directories(files.run_folder);
  const Status status = TrainEnsemble(rows.view(), files, *ensemble, quiet, kNeverStops).status();
  CHECK(status.code() == StatusCode::kFailedPrecondition);
  CHECK(status.message().find("hold-out error") != std::string::npos);
  CHECK_FALSE(fs::exists(files.cache_folder));
}

TEST_CASE("A cache that cannot be written fails no run, and an ensemble that diverges does") {
  TemporaryFolder folder;
  Rows rows;
  EnsembleFiles files = FilesIn(folder, "run");
  WriteBytes(folder.File("file"), "not a folder");
  files.cache_folder = folder.File("file");
  TrainIn(files, rows);

  rows.targets.view()(0, 5) = std::numeric_limits<float>::quiet_NaN();
  Result<DynamicsEnsemble<float>> ensemble = DynamicsEnsemble<float>::Create(Small());
  REQUIRE(ensemble.ok());
  Progress quiet(true);
  CHECK(TrainEnsemble(rows.view(), files, *ensemble, quiet, kNeverStops).status().code() ==
        StatusCode::kFailedPrecondition);
}

}  // namespace b4mrl

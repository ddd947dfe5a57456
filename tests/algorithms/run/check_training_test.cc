// What is said of a run before anything is opened for it.
#include <catch2/catch.hpp>
#include <string>

#include "algorithms/cores/h2o_core.h"
#include "algorithms/list.h"
#include "algorithms/run/check_training.h"
#include "client/remote_dataset.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

EnvironmentSpec SpecOf(const std::string& name, size_t observation_size, size_t action_size) {
  EnvironmentSpec spec;
  spec.name = name;
  spec.observation.dimensions.resize(observation_size);
  spec.action.dimensions.resize(action_size, {"", "", -1, 1});
  spec.termination.emplace();  // it never ends
  return spec;
}

const EnvironmentSpec kCheetah = SpecOf("HalfCheetah", 17, 6);
const EnvironmentSpec kHumanoid = SpecOf("Humanoid", 376, 17);

TrainOptions OptionsOf(const std::string& algorithm) {
  TrainOptions options;
  options.algorithm = algorithm;
  const auto found = FindAlgorithm(algorithm);
  REQUIRE(found.ok());
  options.hyperparameters = Hyperparameters((*found)->hyperparameters);
  return options;
}

Status CheckWith(const std::string& algorithm, std::string_view name, double value,
                 const EnvironmentSpec& environment = kCheetah) {
  TrainOptions options = OptionsOf(algorithm);
  REQUIRE(options.hyperparameters.Set(name, value).ok());
  return CheckTraining(options, environment);
}

bool Names(const Status& status, std::string_view name) {
  return status.code() == StatusCode::kInvalidArgument &&
         status.message().find(name) != std::string::npos;
}

}  // namespace

TEST_CASE("Every algorithm's defaults go together, with every environment's sizes") {
  for (const Algorithm& algorithm : Algorithms()) {
    INFO(algorithm.name);
    CHECK(CheckTraining(OptionsOf(std::string(algorithm.name)), kCheetah).ok());
    CHECK(CheckTraining(OptionsOf(std::string(algorithm.name)), kHumanoid).ok());
  }
}

TEST_CASE("MOPO is refused where observations do not tell that an episode ends") {
  EnvironmentSpec unknown = kCheetah;
  unknown.termination.reset();
  CHECK(CheckTraining(OptionsOf("mopo"), unknown).code() == StatusCode::kUnsupported);
  CHECK(CheckTraining(OptionsOf("hymopo"), unknown).ok());
}

TEST_CASE("An environment whose actions no learner can scale is refused") {
  EnvironmentSpec one_sided = kCheetah;
  one_sided.action.dimensions[3].low = 0;
  const Status refused = CheckTraining(OptionsOf("sac"), one_sided);
  CHECK(refused.code() == StatusCode::kUnsupported);
  CHECK(refused.message().find("of HalfCheetah lies in 0..1, allowed: -x..x") != std::string::npos);
}

TEST_CASE("A history that no agent file holds is refused by name") {
  TrainOptions options = OptionsOf("sac");
  options.history_length = 10;
  CHECK(CheckTraining(options, kHumanoid).ok());
  options.history_length = 11;
  CHECK(Names(CheckTraining(options, kHumanoid), "--history"));
  CHECK(CheckTraining(options, kCheetah).ok());
  options.history_length = 65;
  CHECK(Names(CheckTraining(options, kCheetah), "--history"));
}

TEST_CASE("A score to stop at is refused where there are returns alone") {
  TrainOptions options = OptionsOf("sac");
  options.stop_at_score = 40;
  CHECK(Names(CheckTraining(options, kHumanoid), "--stop-at-score"));
  EnvironmentSpec scored = kCheetah;
  scored.reference_min = -280;
  scored.reference_max = 12'135;
  CHECK(CheckTraining(options, scored).ok());
}

TEST_CASE("bf16 is refused where there are no two hidden layers to multiply between") {
  for (const Algorithm& algorithm : Algorithms()) {
    INFO(algorithm.name);
    TrainOptions options = OptionsOf(std::string(algorithm.name));
    options.precision = Precision::kBf16;
    const bool has_ensemble = options.hyperparameters.Find("ensemble-members") != nullptr;
    REQUIRE(options.hyperparameters.Set("hidden-layers", 1).ok());
    CHECK(Names(CheckTraining(options, kCheetah), "--precision") == !has_ensemble);
    REQUIRE(options.hyperparameters.Set("hidden-layers", 2).ok());
    // A processor without bf16 gets another error.
    CHECK_FALSE(Names(CheckTraining(options, kCheetah), "--precision"));
  }
}

TEST_CASE("The seed of a corruption is refused without a corruption, but not of a run begun so") {
  const Algorithm& cloning = **FindAlgorithm("bc");
  TrainOptions options = OptionsOf("bc");
  options.environment = "HalfCheetah";
  options.dataset = "HalfCheetah/medium";
  options.corruption_seed = 1;
  CHECK(Names(CheckNeeds(options, cloning), "--corruption-seed"));
  options.resume = true;
  CHECK(CheckNeeds(options, cloning).ok());
  options.resume = false;
  options.corruption = "obs-noise=0.1";
  CHECK(CheckNeeds(options, cloning).ok());
}

TEST_CASE("An ensemble that its file could not give back is refused, and the bound is exact") {
  const Status status = CheckWith("mopo", "ensemble-width", 4096);
  INFO(status.ToString());
  REQUIRE(Names(status, "ensemble-width"));
  const size_t at = status.message().find("1..");
  REQUIRE(at != std::string::npos);
  const int most = std::stoi(status.message().substr(at + 3));
  CHECK(most > 1000);
  CHECK(CheckWith("mopo", "ensemble-width", most).ok());
  CHECK(Names(CheckWith("mopo", "ensemble-width", most + 1), "ensemble-width"));
  CHECK(Names(CheckWith("hymopo", "ensemble-elites", 8), "ensemble-elites"));
}

TEST_CASE("The widest policy of the longest history fits an agent file and a checkpoint") {
  for (const Algorithm& algorithm : Algorithms()) {
    const Hyperparameters values(algorithm.hyperparameters);
    const double width = values.Find("hidden-width")->high;
    const double deeper = values.Find("hidden-layers")->high - 1;  // layers behind the first
    INFO(algorithm.name);
    CHECK(deeper + 1 <= 16);  // as an agent file holds
    const double inputs = 4096 + 17;
    CHECK(2 * ((inputs + 1) + deeper * (width + 1) + 2) * width <
          static_cast<double>(kMaxReadFloats));
  }
}

TEST_CASE("A batch whose rows of the dataset no request holds is refused, and the bound is exact") {
  for (const char* algorithm : {"bc", "td3-bc", "iql"}) {
    INFO(algorithm);
    CHECK(CheckWith(algorithm, "batch-size", limits::kMaxRowsPerBatch).ok());
    const auto most = RemoteDataset::MaxRowsPerRequest(376, 17);
    REQUIRE(most < limits::kMaxRowsPerBatch);  // wide rows: the payload is the limit
    CHECK(CheckWith(algorithm, "batch-size", most, kHumanoid).ok());
    CHECK(Names(CheckWith(algorithm, "batch-size", most + 1, kHumanoid), "batch-size"));
  }
  for (const char* algorithm : {"mopo", "hymopo"}) {  // a twentieth of a batch is the dataset's
    INFO(algorithm);
    CHECK(CheckWith(algorithm, "batch-size", 65'536, kHumanoid).ok());
    TrainOptions options = OptionsOf(algorithm);
    REQUIRE(options.hyperparameters.Set("batch-size", 65'536).ok());
    REQUIRE(options.hyperparameters.Set("real-ratio", 1).ok());
    CHECK(CheckTraining(options, kCheetah).ok());
    CHECK(Names(CheckTraining(options, kHumanoid), "batch-size * real-ratio"));
  }
}

TEST_CASE("H2O refuses more rows of the dataset in an update than a request holds") {
  TrainOptions options = OptionsOf("h2o");
  const auto set = [&](std::string_view name, double value) {
    REQUIRE(options.hyperparameters.Set(name, value).ok());
  };
  set("gap-samples", 1);
  set("batch-size", 65'534);
  set("discriminator-batch", 32'768);  // with 32,767 real rows, one less than 65,536
  CHECK(CheckTraining(options, kCheetah).ok());
  CHECK(Names(CheckTraining(options, kHumanoid), "discriminator-batch"));
  set("real-ratio", 0.6);
  CHECK(Names(CheckTraining(options, kCheetah), "discriminator-batch"));
}

TEST_CASE("H2O refuses a batch of one kind, and more noisy copies than memory should hold") {
  CHECK(Names(CheckWith("h2o", "real-ratio", 1), "real-ratio"));
  CHECK(Names(CheckWith("h2o", "real-ratio", 0), "real-ratio"));
  CHECK(CheckWith("h2o", "gap-samples", 1024).ok());
  TrainOptions options = OptionsOf("h2o");
  REQUIRE(options.hyperparameters.Set("gap-samples", 1024).ok());
  REQUIRE(options.hyperparameters.Set("batch-size", 65'536).ok());
  CHECK(Names(CheckTraining(options, kCheetah), "gap-samples"));

  H2oOptions core;
  core.observation_size = 17;
  core.action_size = 6;
  core.batch_max = 65'536;
  core.gap_noise.assign(17, 0.1);
  core.gap_samples = 1024;
  CHECK(Names(H2oCore<float>::Create(core).status(), "gap_samples"));
}

}  // namespace b4mrl

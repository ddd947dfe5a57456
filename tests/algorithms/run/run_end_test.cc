// How runs end: what they leave for whoever looks at them, and for whoever continues them.
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

#include "algorithms/base/checkpoint.h"
#include "algorithms/list.h"
#include "algorithms/run/train_loop.h"
#include "data/d4rl/agent_file.h"
#include "tests/algorithms/fake_episodes.h"
#include "tests/algorithms/logged_rows.h"
#include "tests/data/file_size_limit.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

constexpr uint64_t kSeed = 3;
using Picks = std::function<bool(const pb::Request&)>;

// A daemon with a small dataset and a simulator, whose episodes last one step, that learners train
// with, and that can be lost: then it refuses the requests that were picked.
class LosableDaemon {
 public:
  explicit LosableDaemon(Picks picks)
      : picks_(std::move(picks)),
        daemon_([this](FakeServer& server, FakeCall& call) { return Play(server, call); }) {
    daemon_.dataset_environment = "HalfCheetah";
  }

  Client Connect() const { return Take(Client::Connect(daemon_.address())); }
  std::atomic<bool> lost = false;
  // How it refuses; set before it is lost.
  StatusCode loss = StatusCode::kUnavailable;
  // What its ledgers say from the first refusal on, and how often they were asked then.
  std::atomic<uint64_t> used_rows = 0;
  std::atomic<int> asked_for_ledgers = 0;

 private:
  bool Play(FakeServer& server, FakeCall& call) {
    if (lost && picks_(call.request)) {
      refused_ = true;
      server.ReplyError(call, Status(loss, "the daemon is lost"));
      return true;
    }
    if (call.request.has_ledger()) {
      if (refused_) ++asked_for_ledgers;
      pb::Reply reply;
      reply.mutable_ledger()->set_ledger(1);
      reply.mutable_ledger()->set_dataset_rows(refused_ ? used_rows.load() : 0);
      server.Reply(call, std::move(reply));
      return true;
    }
    if (!call.request.has_catalogue()) return EndsEveryStep(Cause::kLimit)(server, call);
    AnswerCatalogue(server, call);
    return true;
  }

  static void AnswerCatalogue(FakeServer& server, const FakeCall& call) {
    pb::Reply reply;
    pb::EnvironmentInfo* info = reply.mutable_catalogue()->add_environments();
    info->set_name("HalfCheetah");
    const auto add = [](pb::Space* space, size_t count) {
      for (size_t i = 0; i < count; ++i) {
        space->add_dimensions()->set_low(-1);
        space->mutable_dimensions()->rbegin()->set_high(1);
      }
    };
    add(info->mutable_observation(), kObservationSize);
    add(info->mutable_action(), kActionSize);
    info->mutable_termination();  // episodes end by the step limit alone
    server.Reply(call, std::move(reply));
  }

  Picks picks_;
  std::atomic<bool> refused_ = false;
  FakeDaemon daemon_;  // last: its thread uses the members above
};

TrainOptions SmallRun(const std::string& algorithm, const std::string& folder) {
  const Algorithm* entry = Take(FindAlgorithm(algorithm));
  TrainOptions options;
  options.algorithm = algorithm;
  options.environment = "HalfCheetah";
  options.dataset = "HalfCheetah/small";
  options.seed = kSeed;
  options.updates = 60;
  options.eval_every = 20;
  options.eval_episodes = 1;
  options.log_every = 5;
  options.checkpoint_every = 60;
  options.folder = folder;
  options.hyperparameters = Hyperparameters(entry->hyperparameters);
  for (const auto& [name, value] : {std::pair{"hidden-width", 8.0},
                                    {"batch-size", 16},
                                    {"real-ratio", 0.5},
                                    {"ensemble-width", 8},
                                    {"ensemble-max-updates", 5},
                                    {"ensemble-cache", 0},
                                    {"rollout-every", 20},
                                    {"rollout-rows", 20},
                                    {"model-retain", 2}}) {
    if (options.hyperparameters.Find(name) == nullptr) continue;
    RequireOk(options.hyperparameters.Set(name, value));
  }
  return options;
}

Result<TrainSummary> TryTraining(const TrainOptions& options, Client& client) {
  const std::atomic<bool> stop = false;
  Progress quiet(true);
  return Train(options, client, quiet, stop);
}

bool IsSampleOf(const pb::Request& request, std::string_view role, uint64_t first) {
  return request.has_sample() && request.sample().seed() == RoleSeed(kSeed, role) &&
         request.sample().first_batch() >= first;
}

// The opening of the dataset for the learner, behind that by which Train asks whether it opens.
Picks OpeningForTheRun() {
  return [opened = 0](const pb::Request& request) mutable {
    return request.has_open_dataset() && opened++ > 0;
  };
}

nlohmann::json ResultOf(const TrainOptions& options) {
  return nlohmann::json::parse(ReadBytes(options.folder + "/result.json"));
}

}  // namespace

TEST_CASE("A run that loses its daemon keeps its last update and goes on from there bit for bit") {
  struct Loss {
    const char* algorithm;
    bool lag;
    Picks picks;
  };
  const Picks batches = [](const pb::Request& request) {
    return IsSampleOf(request, "batches", 25);
  };
  const Picks starts = [](const pb::Request& request) {
    return IsSampleOf(request, "rollout-starts", 2);
  };
  const Picks queries = [](const pb::Request& request) {
    return request.has_query() && request.query().draw() > 12;  // five a cycle, after the pre-pass
  };
  const Loss loss = GENERATE_COPY(
      Loss{"td3-bc", false, batches}, Loss{"iql", false, batches}, Loss{"mopo", false, batches},
      Loss{"mopo", false, starts}, Loss{"mopo", true, starts}, Loss{"hymopo", false, starts},
      Loss{"hymopo", false, queries}, Loss{"hymopo", true, starts}, Loss{"hymopo", true, queries});
  INFO(loss.algorithm << ", lag " << loss.lag);
  const TemporaryFolder folder;
  LosableDaemon daemon(loss.picks);
  Client client = daemon.Connect();
  TrainOptions straight = SmallRun(loss.algorithm, folder.File("straight"));
  if (loss.lag) RequireOk(straight.hyperparameters.Set("rollout-lag", 1));
  RequireOk(TryTraining(straight, client).status());

  TrainOptions cut = straight;
  cut.folder = folder.File("cut");
  daemon.lost = true;
  const Status status = TryTraining(cut, client).status();
  CHECK(status.code() == StatusCode::kUnavailable);
  const RunStatus left = Take(ReadRunStatus(cut.folder));
  CHECK(left.state == RunState::kFailed);
  CHECK(left.reason == status.ToString());
  CHECK(left.updates >= 20);
  CHECK(left.updates < 60);
  CHECK(Take(ListCheckpoints(cut.folder)).front() == left.updates);
  daemon.lost = false;
  cut.resume = true;
  RequireOk(TryTraining(cut, client).status());
  CHECK((ReadBytes(straight.folder + "/agent.h5") == ReadBytes(cut.folder + "/agent.h5")));
  CHECK(RowsWithoutTimes(straight.folder) == RowsWithoutTimes(cut.folder));
}

TEST_CASE("An evaluation that fails with the daemon is owed by the run that goes on") {
  const TemporaryFolder folder;
  LosableDaemon daemon([](const pb::Request& request) { return request.has_step(); });
  Client client = daemon.Connect();
  const TrainOptions straight = SmallRun("td3-bc", folder.File("straight"));
  RequireOk(TryTraining(straight, client).status());
  TrainOptions cut = SmallRun("td3-bc", folder.File("cut"));
  daemon.lost = true;
  CHECK(TryTraining(cut, client).status().code() == StatusCode::kUnavailable);
  CHECK(Take(ReadRunStatus(cut.folder)).updates == cut.eval_every);
  CHECK_FALSE(std::filesystem::exists(cut.folder + "/agent.h5"));  // it has no returns yet
  daemon.lost = false;
  cut.resume = true;
  RequireOk(TryTraining(cut, client).status());
  CHECK(RowsWithoutTimes(straight.folder) == RowsWithoutTimes(cut.folder));
  CHECK(std::filesystem::exists(cut.folder + "/agent.h5"));
}

TEST_CASE("A row that could not be written is written by the run that goes on") {
  const TemporaryFolder folder;
  LosableDaemon daemon([](const pb::Request&) { return false; });
  Client client = daemon.Connect();
  TrainOptions straight = SmallRun("td3-bc", folder.File("straight"));
  straight.updates = 900;
  straight.checkpoint_every = 900;
  straight.eval_every = GENERATE(1, 900);  // rows with an evaluation, and without one
  straight.log_every = 1;
  RequireOk(TryTraining(straight, client).status());
  TrainOptions cut = straight;
  cut.folder = folder.File("cut");
  const auto checkpoint = std::filesystem::file_size(CheckpointPath(straight.folder, 900));
  const auto rows = std::filesystem::file_size(straight.folder + "/metrics.jsonl");
  REQUIRE(checkpoint + 10'000 < rows);  // so that a disk with room for one lacks it for the other
  {
    const FileSizeLimit full((checkpoint + rows) / 2);
    CHECK(TryTraining(cut, client).status().code() == StatusCode::kIoError);
  }
  const uint64_t kept = Take(ReadRunStatus(cut.folder)).updates;
  CHECK(kept > 0);
  CHECK(Take(ListCheckpoints(cut.folder)).front() == kept);
  cut.resume = true;
  RequireOk(TryTraining(cut, client).status());
  CHECK((RowsWithoutTimes(straight.folder) == RowsWithoutTimes(cut.folder)));
}

TEST_CASE("A run says that it is running, and a continued one no longer that it has finished") {
  const TemporaryFolder folder;
  TrainOptions options = SmallRun("td3-bc", folder.File("run"));
  options.updates = 20;
  std::atomic<bool> said_running = false;
  std::atomic<uint64_t> said_updates = 1;
  LosableDaemon daemon([&](const pb::Request& request) {
    if (!IsSampleOf(request, "batches", 25)) return false;
    const auto status = ReadRunStatus(options.folder);
    said_running = status.ok() && status->state == RunState::kRunning;
    if (status.ok()) said_updates = status->updates;
    return true;
  });
  Client client = daemon.Connect();
  CHECK(Take(TryTraining(options, client)).state == RunState::kFinished);
  CHECK(Take(ReadRunStatus(options.folder)).state == RunState::kFinished);
  const nlohmann::json before = ResultOf(options);
  CHECK(before["updates"] == 20);
  CHECK(before["interrupted"] == false);
  CHECK(before["dataset"] == "HalfCheetah/small");
  CHECK(before["dataset_full_name"] == "HalfCheetah/small-v0");
  CHECK(before["dataset_columns_sha256"] == "c");
  CHECK(Take(ReadAgent(options.folder + "/agent.h5")).provenance.dataset == "HalfCheetah/small-v0");

  options.resume = true;
  options.updates = 60;
  daemon.lost = true;
  std::filesystem::remove(CheckpointPath(options.folder, 20));
  CHECK_FALSE(TryTraining(options, client).ok());
  CHECK(said_running);
  CHECK(said_updates == 0);  // those of the checkpoint that it goes on from
  const nlohmann::json after = ResultOf(options);
  CHECK(after["state"] == "failed");
  CHECK(after["updates"] > 20);
  CHECK(after["mean_return"] == before["mean_return"]);
}

TEST_CASE("A run that cannot be continued says why, and keeps its scores") {
  const TemporaryFolder folder;
  LosableDaemon daemon(OpeningForTheRun());
  Client client = daemon.Connect();
  TrainOptions options = SmallRun("td3-bc", folder.File("run"));
  RequireOk(TryTraining(options, client).status());
  const nlohmann::json before = ResultOf(options);
  options.resume = true;
  options.updates = 100;
  daemon.lost = true;
  CHECK_FALSE(TryTraining(options, client).ok());
  nlohmann::json after = ResultOf(options);
  CHECK(after["state"] == "failed");
  CHECK(after["reason"].get<std::string>().find("the daemon is lost") != std::string::npos);
  after["state"] = before["state"];
  after["reason"] = before["reason"];
  CHECK(after == before);
}

TEST_CASE("A run that could not begin says why") {
  const TemporaryFolder folder;
  LosableDaemon daemon(OpeningForTheRun());
  Client client = daemon.Connect();
  daemon.lost = true;
  const TrainOptions options = SmallRun("td3-bc", folder.File("run"));
  CHECK_FALSE(TryTraining(options, client).ok());
  CHECK(Take(ReadRunStatus(options.folder)).state == RunState::kFailed);
}

TEST_CASE("A run that failed says what it has used, unless that means to wait for its daemon") {
  const bool gone = GENERATE(false, true);
  INFO(gone);
  const TemporaryFolder folder;
  LosableDaemon daemon(
      [](const pb::Request& request) { return IsSampleOf(request, "batches", 25); });
  daemon.loss = gone ? StatusCode::kUnavailable : StatusCode::kInternal;
  daemon.used_rows = 77;
  daemon.lost = true;
  Client client = daemon.Connect();
  const TrainOptions options = SmallRun("td3-bc", folder.File("run"));
  CHECK(TryTraining(options, client).status().code() == daemon.loss);
  CHECK(ResultOf(options)["ledger"]["dataset_rows"] == (gone ? 0 : 77));
  // The checkpoint of its last update says the same, from which a resumed run counts on.
  const uint64_t kept = Take(ListCheckpoints(options.folder)).front();
  REQUIRE(kept > 0);
  CheckpointReader reader = Take(CheckpointReader::Open(CheckpointPath(options.folder, kept)));
  CHECK(reader.Unsigned("run/ledger/dataset_rows") == (gone ? 0 : 77));
  CHECK((daemon.asked_for_ledgers == 0) == gone);
}

TEST_CASE("A run without updates is evaluated, and goes on as if it had not been") {
  const TemporaryFolder folder;
  LosableDaemon daemon([](const pb::Request&) { return false; });
  Client client = daemon.Connect();
  const TrainOptions straight = SmallRun("td3-bc", folder.File("straight"));
  RequireOk(TryTraining(straight, client).status());
  TrainOptions options = SmallRun("td3-bc", folder.File("run"));
  options.updates = 0;
  const TrainSummary summary = Take(TryTraining(options, client));
  CHECK(summary.state == RunState::kFinished);
  REQUIRE(summary.last);
  CHECK(summary.last->returns.size() == 1);
  CHECK(Take(ReadAgent(options.folder + "/agent.h5")).provenance.updates == 0);
  CHECK(LoggedRows(options.folder).size() == 1);
  options.updates = straight.updates;
  options.resume = true;
  RequireOk(TryTraining(options, client).status());
  CHECK(RowsWithoutTimes(straight.folder) == RowsWithoutTimes(options.folder));
}

TEST_CASE("A run cannot be resumed with fewer updates than it has done") {
  const TemporaryFolder folder;
  LosableDaemon daemon([](const pb::Request&) { return false; });
  Client client = daemon.Connect();
  TrainOptions options = SmallRun("td3-bc", folder.File("run"));
  options.updates = 20;
  RequireOk(TryTraining(options, client).status());
  const std::string before = ReadBytes(options.folder + "/config.toml");
  options.resume = true;
  options.updates = 19;
  const Status refused = TryTraining(options, client).status();
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(refused.message(), Catch::Contains("--updates") && Catch::Contains("at least 20"));
  CHECK(ReadBytes(options.folder + "/config.toml") == before);
  CHECK(Take(ReadRunStatus(options.folder)).state == RunState::kFinished);
  options.updates = 20;
  RequireOk(TryTraining(options, client).status());
}

TEST_CASE("A run that is ended at a row without an evaluation is evaluated there") {
  const TemporaryFolder folder;
  LosableDaemon daemon([](const pb::Request&) { return false; });
  Client client = daemon.Connect();
  TrainOptions straight = SmallRun("td3-bc", folder.File("straight"));
  straight.log_every = 5;
  straight.eval_every = 20;
  straight.checkpoint_every = 5;
  straight.updates = 25;
  const TrainSummary expected = Take(TryTraining(straight, client));
  // A longer run that was killed after its checkpoint at 25, where it wrote a row.
  TrainOptions cut = straight;
  cut.updates = 30;
  cut.folder = folder.File("cut");
  RequireOk(TryTraining(cut, client).status());
  std::filesystem::remove(CheckpointPath(cut.folder, 30));
  REQUIRE(Take(ListCheckpoints(cut.folder)).front() == 25);
  cut.resume = true;
  cut.updates = 25;
  cut.eval_every = GENERATE(20, 25);  // the latter as if the row had an evaluation
  const TrainSummary ended = Take(TryTraining(cut, client));
  CHECK(ended.updates == 25);
  CHECK(ended.last->returns == expected.last->returns);
  CHECK(Take(ReadAgent(cut.folder + "/agent.h5")).provenance.updates == 25);
}

TEST_CASE("An agent's file says for which world it was trained") {
  const TemporaryFolder folder;
  LosableDaemon daemon([](const pb::Request&) { return false; });
  Client client = daemon.Connect();
  TrainOptions options = SmallRun("td3-bc", folder.File("run"));
  options.world = "action-delay";
  RequireOk(TryTraining(options, client).status());
  CHECK(Take(ReadAgent(options.folder + "/agent.h5")).provenance.world == "action-delay");
}

}  // namespace b4mrl

// What a run has used: how the daemon's counts become the run's totals, and that they are true.
#include "algorithms/run/run_ledger.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "algorithms/list.h"
#include "algorithms/run/train_loop.h"
#include "tests/algorithms/logged_rows.h"
#include "tests/algorithms/test_daemon.h"
#include "tests/client/fake_daemon.h"

namespace b4mrl {
namespace {

// A daemon whose ledgers the test writes, and that refuses to read or open them when told to.
class Accountant {
 public:
  Accountant()
      : daemon_([this](FakeServer& server, FakeCall& call) {
          if (!call.request.has_ledger()) return false;
          Answer(server, call);
          return true;
        }) {}

  Client Connect() const { return Take(Client::Connect(daemon_.address())); }
  void Set(uint64_t ledger, const LedgerCounts& counts) {
    const std::lock_guard lock(mutex_);
    ledgers_[ledger] = counts;
  }
  void Lose(uint64_t ledger) {
    const std::lock_guard lock(mutex_);
    ledgers_.erase(ledger);
  }
  std::atomic<bool> is_busy = false;

 private:
  void Answer(FakeServer& server, const FakeCall& call) {
    const std::lock_guard lock(mutex_);
    uint64_t number = call.request.ledger().ledger();
    if (is_busy) return server.ReplyError(call, Status(StatusCode::kUnavailable, "busy"));
    if (number == 0) ledgers_[number = ++last_];
    const auto found = ledgers_.find(number);
    if (found == ledgers_.end()) {
      return server.ReplyError(call, Status(StatusCode::kUnknownName, "no such ledger"));
    }
    pb::Reply reply;
    reply.mutable_ledger()->set_ledger(number);
    reply.mutable_ledger()->set_steps(found->second.steps);
    reply.mutable_ledger()->set_episodes(found->second.episodes);
    reply.mutable_ledger()->set_query_rows(found->second.query_rows);
    reply.mutable_ledger()->set_dataset_rows(found->second.dataset_rows);
    server.Reply(call, std::move(reply));
  }

  std::mutex mutex_;
  std::map<uint64_t, LedgerCounts> ledgers_;  // under mutex_
  uint64_t last_ = 0;                         // number of the newest; under mutex_
  FakeDaemon daemon_;                         // last: its thread uses the members above
};

void RequireUse(const RunLedger& ledger, const RunUse& expected) {
  for (const RunUseEntry& entry : kRunUseEntries) {
    INFO(entry.name);
    CHECK(ledger.use().*entry.value == expected.*entry.value);
  }
}

// Saves `from` in a checkpoint and loads it into `to`.
void PassOn(const RunLedger& from, RunLedger& to) {
  const TemporaryFolder folder;
  CheckpointWriter writer = Take(CheckpointWriter::Create(folder.File("checkpoint.h5")));
  from.Save(writer);
  RequireOk(writer.Commit());
  CheckpointReader reader = Take(CheckpointReader::Open(folder.File("checkpoint.h5")));
  to.Load(reader);
  RequireOk(reader.status());
}

// The options of a small run of any learner.
TrainOptions SmallRun(TestDaemon& daemon, std::string_view algorithm) {
  const Algorithm* entry = Take(FindAlgorithm(algorithm));
  TrainOptions options;
  options.algorithm = algorithm;
  options.environment = "HalfCheetah";
  options.simulator = entry->needs.simulator ? "gravity" : "";
  options.dataset = entry->needs.dataset ? "HalfCheetah/small" : "";
  options.seed = 3;
  options.updates = 60;
  options.eval_every = 20;
  options.eval_episodes = 2;
  options.log_every = 10;
  options.checkpoint_every = 30;
  options.folder = daemon.folder("run");
  options.hyperparameters = Hyperparameters(entry->hyperparameters);
  for (const auto& [name, value] : {std::pair{"hidden-width", 16.0},
                                    {"batch-size", 32.0},
                                    {"lanes", 2.0},
                                    {"warm-up", 100.0},
                                    {"ensemble-width", 16.0},
                                    {"ensemble-max-updates", 20.0},
                                    {"rollout-every", 20.0},
                                    {"rollout-rows", 100.0},
                                    {"chunk-rows", 30.0}}) {
    if (options.hyperparameters.Find(name) == nullptr) continue;
    RequireOk(options.hyperparameters.Set(name, value));
  }
  if (entry->needs.dataset) daemon.MakeDataset("small", 500);
  return options;
}

constexpr uint64_t kEvaluatedEpisodes = 3 * 2;  // three evaluations of two episodes each

// Runs it, and returns the row of its last evaluation and what result.json says of it.
nlohmann::json UseOf(TestDaemon& daemon, const TrainOptions& options) {
  const std::atomic<bool> stop = false;
  Progress quiet(true);
  const TrainSummary summary = Take(Train(options, daemon.client(), quiet, stop));
  const auto rows = LoggedRows(options.folder);
  const auto result = nlohmann::json::parse(ReadBytes(options.folder + "/result.json"), nullptr,
                                            /*allow_exceptions=*/false);
  REQUIRE(rows.size() == 6);
  for (const RunUseEntry& entry : kRunUseEntries) {
    const std::string name(entry.name);
    INFO(name);
    CHECK_FALSE(rows[0].contains(name));  // an update without an evaluation
    REQUIRE(rows.back().contains(name));
    // The last checkpoint comes after the last row; batches may have been served in between.
    CHECK(result["ledger"][name] >= rows.back()[name]);
    CHECK(result["ledger"][name] == summary.use.*entry.value);
  }
  CHECK(rows[3]["evaluation_episodes"] == 4);
  return rows.back();
}

}  // namespace

TEST_CASE("Totals are what the learner's and the evaluations' ledgers counted") {
  Accountant daemon;
  Client client = daemon.Connect();
  RunLedger ledger(client);
  CHECK(ledger.learner() == 1);
  CHECK(ledger.evaluations() == 2);
  RequireUse(ledger, {});
  daemon.Set(1, {.steps = 10, .episodes = 5, .query_rows = 20, .dataset_rows = 30});
  daemon.Set(2, {.steps = 7000, .episodes = 7});
  RequireUse(ledger, {});  // nobody has asked yet
  ledger.Refresh();
  RequireUse(ledger, {10, 20, 30, 7});
}

TEST_CASE("While the daemon does not answer, the last totals hold") {
  Accountant daemon;
  Client client = daemon.Connect();
  RunLedger ledger(client);
  daemon.Set(1, {.steps = 10});
  ledger.Refresh();
  daemon.Set(1, {.steps = 15});
  daemon.is_busy = true;
  ledger.Refresh();
  CHECK(ledger.learner() == 1);
  RequireUse(ledger, {.simulator_steps = 10});
  daemon.is_busy = false;
  ledger.Refresh();
  RequireUse(ledger, {.simulator_steps = 15});
}

TEST_CASE("A lost ledger is replaced, and the new one goes on from the totals") {
  Accountant daemon;
  Client client = daemon.Connect();
  RunLedger ledger(client);
  daemon.Set(1, {.steps = 10, .query_rows = 3});
  ledger.Refresh();
  daemon.Lose(1);
  ledger.Refresh();
  CHECK(ledger.learner() == 3);
  RequireUse(ledger, {.simulator_steps = 10, .query_rows = 3});
  daemon.Set(3, {.steps = 4});
  ledger.Refresh();
  RequireUse(ledger, {.simulator_steps = 14, .query_rows = 3});
}

TEST_CASE("A run whose daemon has no room for ledgers counts once it has") {
  Accountant daemon;
  Client client = daemon.Connect();
  daemon.is_busy = true;
  RunLedger ledger(client);
  CHECK(ledger.learner() == 0);
  CHECK(ledger.evaluations() == 0);
  daemon.is_busy = false;
  ledger.Refresh();
  CHECK(ledger.learner() == 1);
  daemon.Set(1, {.steps = 5});
  ledger.Refresh();
  RequireUse(ledger, {.simulator_steps = 5});
}

TEST_CASE("A resumed run goes on from its checkpoint, without what its learner has repeated") {
  Accountant daemon;
  Client client = daemon.Connect();
  RunLedger first(client);
  daemon.Set(1, {.steps = 10, .query_rows = 20, .dataset_rows = 30});
  daemon.Set(2, {.episodes = 2});
  first.Refresh();
  RunLedger resumed(client);          // ledgers 3 and 4
  daemon.Set(3, {.query_rows = 20});  // rollouts that fill a buffer again
  PassOn(first, resumed);
  RequireUse(resumed, {10, 20, 30, 2});
  daemon.Set(3, {.steps = 1, .query_rows = 25, .dataset_rows = 6});
  daemon.Set(4, {.episodes = 1});
  resumed.Refresh();
  RequireUse(resumed, {11, 25, 36, 3});
}

TEST_CASE("A checkpoint of an earlier version has no totals, which begin at 0") {
  Accountant daemon;
  Client client = daemon.Connect();
  RunLedger ledger(client);
  const TemporaryFolder folder;
  CheckpointWriter writer = Take(CheckpointWriter::Create(folder.File("checkpoint.h5")));
  writer.Unsigned("run/update", 1);
  RequireOk(writer.Commit());
  CheckpointReader reader = Take(CheckpointReader::Open(folder.File("checkpoint.h5")));
  daemon.Set(1, {.steps = 10});
  ledger.Load(reader);
  RequireOk(reader.status());
  RequireUse(ledger, {});
  daemon.Set(1, {.steps = 12});
  ledger.Refresh();
  RequireUse(ledger, {.simulator_steps = 2});
}

TEST_CASE("An online learner's simulator steps are its environment steps") {
  TestDaemon daemon;
  const nlohmann::json use = UseOf(daemon, SmallRun(daemon, "sac"));
  CHECK(use["simulator_steps"] == use["environment_steps"]);
  CHECK(use["simulator_steps"] > 0);
  CHECK(use["query_rows"] == 0);
  CHECK(use["dataset_rows"] == 0);
  CHECK(use["evaluation_episodes"] == kEvaluatedEpisodes);
}

TEST_CASE("An offline learner uses the rows of its batches, and no simulator but the true one") {
  TestDaemon daemon;
  const nlohmann::json use = UseOf(daemon, SmallRun(daemon, "td3-bc"));
  CHECK(use["simulator_steps"] == 0);
  CHECK(use["query_rows"] == 0);
  CHECK(use["dataset_rows"] >= 60 * 32);  // some batches are requested ahead
  CHECK(use["evaluation_episodes"] == kEvaluatedEpisodes);
}

TEST_CASE("A learner that corrects a simulator's steps queries every row of data and rollouts") {
  TestDaemon daemon;
  const TrainOptions options = SmallRun(daemon, "hymopo");
  const nlohmann::json use = UseOf(daemon, options);
  CHECK(use["simulator_steps"] == 0);
  // Every row of the dataset once, and in three cycles the steps of rollouts, which may end early.
  const double horizon = options.hyperparameters.Number("horizon");
  CHECK(use["query_rows"] > 500 + 3 * 100);
  CHECK(use["query_rows"] <= 500 + 3 * 100 * horizon);
  CHECK(use["dataset_rows"] >= 500);
  CHECK(use["evaluation_episodes"] == kEvaluatedEpisodes);
}

TEST_CASE("A learner without a simulator queries none, whatever its model rolls out") {
  TestDaemon daemon;
  const nlohmann::json use = UseOf(daemon, SmallRun(daemon, "mopo"));
  CHECK(use["simulator_steps"] == 0);
  CHECK(use["query_rows"] == 0);
  CHECK(use["dataset_rows"] >= 500);
}

}  // namespace b4mrl

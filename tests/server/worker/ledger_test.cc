// What an environment worker counts in the ledger of a session.
#include <catch2/catch.hpp>

#include "server/shared_memory/ledger_table.h"
#include "tests/results.h"
#include "tests/server/worker/worker_fixture.h"

namespace b4mrl {
namespace {

constexpr uint64_t kEpisodeSteps = 2;

// A worker with a session of `lanes` lanes that were reset and whose episodes have kEpisodeSteps.
class CountingWorker {
 public:
  explicit CountingWorker(uint32_t lanes, pb::AutoresetMode mode = pb::NEXT_STEP)
      : numbers_(lanes, 0), ledger_(Take(LedgerTable(worker.state()).Open())) {
    worker.open.set_ledger(ledger_);
    worker.open.set_autoreset_mode(mode);
    worker.open.set_config(R"({"max_episode_steps": 2})");
    worker.Open(lanes);
    Advance();
    REQUIRE(worker.Reset(numbers_).code() == StatusCode::kOk);
  }

  void Step(int times = 1) {
    for (int i = 0; i < times; ++i) {
      Advance();
      REQUIRE(worker.Step(numbers_, 0.25f).code() == StatusCode::kOk);
    }
  }
  LedgerCounts counts() { return Take(LedgerTable(worker.state()).Read(ledger_)); }
  const std::vector<uint64_t>& numbers() const { return numbers_; }

  WorkerFixture worker;

 private:
  void Advance() {
    for (uint64_t& number : numbers_) ++number;
  }

  std::vector<uint64_t> numbers_;  // of each lane's last operation
  uint64_t ledger_;
};

TEST_CASE("Steps and ended episodes of every lane are counted, resets are not") {
  CountingWorker session(3);
  CHECK(session.counts() == LedgerCounts());
  session.Step();
  CHECK(session.counts() == LedgerCounts{.steps = 3});
  session.Step();
  CHECK(session.counts() == LedgerCounts{.steps = 6, .episodes = 3});
  CHECK(session.worker.state().session(0).steps == 6);
}

TEST_CASE("A step that only begins the next episode is no step of the simulator") {
  CountingWorker session(1, pb::NEXT_STEP);
  session.Step(kEpisodeSteps + 1);
  CHECK(session.counts() == LedgerCounts{.steps = kEpisodeSteps, .episodes = 1});
  session.Step(kEpisodeSteps);
  CHECK(session.counts() == LedgerCounts{.steps = 2 * kEpisodeSteps, .episodes = 2});
}

TEST_CASE("In mode SAME_STEP every step is one of the simulator") {
  CountingWorker session(1, pb::SAME_STEP);
  session.Step(2 * kEpisodeSteps);
  CHECK(session.counts() == LedgerCounts{.steps = 2 * kEpisodeSteps, .episodes = 2});
}

TEST_CASE("An episode that is stepped on past its end has ended once") {
  CountingWorker session(1, pb::DISABLED);
  session.Step(kEpisodeSteps + 3);
  CHECK(session.counts() == LedgerCounts{.steps = kEpisodeSteps + 3, .episodes = 1});
}

TEST_CASE("A resent step that is answered from the lane's record is not counted again") {
  CountingWorker session(2);
  session.Step(kEpisodeSteps);
  const LedgerCounts before = session.counts();
  REQUIRE(session.worker.Step(session.numbers(), 0.25f).code() == StatusCode::kOk);
  CHECK(session.counts() == before);
}

TEST_CASE("A replacement of the worker goes on counting in the same ledger") {
  CountingWorker session(2);
  session.Step();
  session.worker.Restart();
  session.Step();
  CHECK(session.counts() == LedgerCounts{.steps = 4, .episodes = 2});
}

TEST_CASE("Rows of queries are counted, those of a refused query are not") {
  CountingWorker session(1);
  pb::Request query;
  query.mutable_query();
  const auto rows = [](uint64_t count) {
    return std::vector<Input>{
        Array<float>("observations", {count, 17}, std::vector<float>(count * 17, 0.1f)),
        Actions(count, 0.25f)};
  };
  REQUIRE(session.worker.Call(query, rows(5)).code() == StatusCode::kOk);
  CHECK(session.counts() == LedgerCounts{.query_rows = 5});
  REQUIRE(session.worker.Call(query, {rows(5)[0], Actions(4, 0.25f)}).code() ==
          StatusCode::kInvalidArgument);
  CHECK(session.counts() == LedgerCounts{.query_rows = 5});
}

TEST_CASE("A session whose ledger does not exist is served like any other") {
  WorkerFixture worker;
  worker.open.set_ledger(GENERATE(uint64_t{1}, uint64_t{limits::kMaxLedgers}, UINT64_MAX));
  worker.Open(1);
  REQUIRE(worker.Reset({1}).code() == StatusCode::kOk);
  CHECK(worker.Step({2}, 0.25f).code() == StatusCode::kOk);
  for (uint32_t i = 0; i < limits::kMaxLedgers; ++i) {
    REQUIRE(worker.state().ledger(i).steps == 0);
  }
}

TEST_CASE("The ledger decides none of a session's numbers") {
  WorkerFixture with, without;
  with.open.set_ledger(Take(LedgerTable(with.state()).Open()));
  const auto attach = [](WorkerFixture& worker) {
    const uint32_t index = worker.Allocate(1);
    REQUIRE(worker.Attach(index) == StatusCode::kOk);
    REQUIRE(SessionTable(worker.state()).MakeLive(index));
    return worker.answers.back().envelope.attach().experiment_id();
  };
  const std::string id = attach(with);
  CHECK_FALSE(id.empty());
  CHECK(attach(without) == id);
  CHECK(with.Reset({1}).payload == without.Reset({1}).payload);
  CHECK(with.Step({2}, 0.25f).payload == without.Step({2}, 0.25f).payload);
}

}  // namespace
}  // namespace b4mrl

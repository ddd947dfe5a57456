// Evaluations beside the training: held rows, checkpoints in between, processes that fail.
#include "algorithms/run/run_log.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <string>

#include "algorithms/base/checkpoint.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// A log in a new folder of the daemon's; its evaluations are done by `evaluator`, "" for b4mrl's.
struct LoggedRun {
  LoggedRun(TestDaemon& daemon, const std::string& name, const std::string& evaluator)
      : client(daemon.client()) {
    options.environment = "HalfCheetah";
    options.eval_episodes = 2;
    options.folder = daemon.folder(name);
    options.evaluator = evaluator;
    fs::create_directories(options.folder);
  }
  RunLog Open() {
    static Progress quiet(true);
    return Take(RunLog::Open(options, client, quiet));
  }
  std::string File(const char* name) const { return ReadBytes(options.folder + "/" + name); }

  Client& client;
  TrainOptions options;
};

std::string Script(TestDaemon& daemon, const std::string& name, const std::string& body) {
  const std::string path = daemon.folder(name);
  WriteBytes(path, "#!/bin/sh\n" + body + "\n");
  fs::permissions(path, fs::perms::owner_all);
  return path;
}

// What a training writes: an evaluated row, and one behind it.
void WriteTwoRows(RunLog& log) {
  RequireOk(log.Evaluate(TestDaemon::RandomAgent(), {{"update", 10}, {"loss", 1.0 / 3}}));
  RequireOk(log.Write({{"update", 20}, {"loss", 0.5}}));
}

void RequireSameLogs(const LoggedRun& a, const LoggedRun& b) {
  CHECK(a.File("metrics.jsonl") == b.File("metrics.jsonl"));
  CHECK(a.File("progress.csv") == b.File("progress.csv"));
}

LoggedRun EvaluatedHere(TestDaemon& daemon) {
  LoggedRun here(daemon, "here", "");
  here.options.eval_inline = true;
  RunLog log = here.Open();
  RequireOk(log.Begin());
  WriteTwoRows(log);
  CHECK(log.evaluations().size() == 1);
  return here;
}

constexpr const char* kNeverEnds = "exec tail -f /dev/null";

}  // namespace

TEST_CASE("Logs are the same whether evaluations run in this process or beside it") {
  TestDaemon daemon;
  const LoggedRun here = EvaluatedHere(daemon);
  LoggedRun beside(daemon, "beside", "");
  RunLog log = beside.Open();
  RequireOk(log.Begin());
  WriteTwoRows(log);
  RequireOk(log.Wait());
  CHECK(log.evaluations().size() == 1);
  RequireSameLogs(here, beside);
}

TEST_CASE("Training does not wait for an evaluation, and its rows do") {
  TestDaemon daemon;
  LoggedRun run(daemon, "run", Script(daemon, "never", kNeverEnds));
  RunLog log = run.Open();
  RequireOk(log.Begin());
  WriteTwoRows(log);
  RequireOk(log.Poll());
  CHECK(log.evaluations().empty());
  CHECK(run.File("metrics.jsonl").empty());
}

TEST_CASE("An evaluation that a kill interrupted is done again with the agent of its update") {
  TestDaemon daemon;
  const LoggedRun here = EvaluatedHere(daemon);
  LoggedRun run(daemon, "run", Script(daemon, "never", kNeverEnds));
  const std::string checkpoint = CheckpointPath(run.options.folder, 20);
  {
    RunLog log = run.Open();
    RequireOk(log.Begin());
    WriteTwoRows(log);
    CheckpointWriter writer = Take(CheckpointWriter::Create(checkpoint));
    RequireOk(log.Save(writer));
    RequireOk(writer.Commit());
  }
  WriteBytes(run.options.folder + "/agent.h5", "of a later update");
  run.options.evaluator = "";
  RunLog log = run.Open();
  CheckpointReader reader = Take(CheckpointReader::Open(checkpoint));
  RequireOk(log.Load(reader));
  RequireOk(log.Wait());
  RequireSameLogs(here, run);
  CHECK(run.File("agent.h5") == here.File("agent.h5"));
}

TEST_CASE("An evaluation whose process fails is done in this one") {
  TestDaemon daemon;
  const LoggedRun here = EvaluatedHere(daemon);
  const std::string evaluators[] = {
      daemon.folder("missing"),
      Script(daemon, "fails", "exit 3"),
      Script(daemon, "dies", "kill -KILL $$"),
      Script(daemon, "babbles", "echo '{\"returns\": [1], \"lengths\": \"x\"}'"),
  };
  for (const std::string& evaluator : evaluators) {
    INFO(evaluator);
    LoggedRun run(daemon, "run", evaluator);
    RunLog log = run.Open();
    RequireOk(log.Begin());
    WriteTwoRows(log);
    RequireOk(log.Wait());
    RequireSameLogs(here, run);
  }
}

TEST_CASE("What is no evaluation's result is refused") {
  for (const char* text : {"", "[]", "{}", R"({"returns":[],"lengths":[]})",
                           R"({"returns":["1"],"lengths":[1],"mean_return":1,"std_return":0})",
                           R"({"returns":[1],"lengths":[1,2],"mean_return":1,"std_return":0})"}) {
    INFO(text);
    CHECK(ParseEvaluation(text).status().code() == StatusCode::kDataLoss);
  }
  const EvaluationResult result =
      Take(ParseEvaluation(R"({"returns":[0.1],"lengths":[7],"mean_return":0.1,"std_return":0,)"
                           R"("score":3,"given_up_episodes":1})"));
  CHECK(result.returns == std::vector<double>{0.1});
  CHECK(result.score == 3);
  CHECK(result.given_up == 1);
}

}  // namespace b4mrl

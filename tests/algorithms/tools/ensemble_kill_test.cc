// kill -9 while an ensemble trains: the run goes on where it stopped, with the same bits.
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/run/run_record.h"
#include "data/d4rl/agent_file.h"
#include "tests/algorithms/test_daemon.h"
#include "tests/algorithms/tools/folder_watch.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

Words TrainWords(const TestDaemon& daemon, const std::string& run,
                 const std::string& dataset = "HalfCheetah/small") {
  return {"train",
          "--algorithm",
          "mopo",
          "--environment",
          "HalfCheetah",
          "--dataset",
          dataset,
          "--endpoint",
          daemon.endpoint(),
          "--out",
          daemon.folder(run),
          "--updates",
          "20",
          "--eval-episodes",
          "1",
          "--hidden-width",
          "16",
          "--rollout-rows",
          "100",
          "--ensemble-width",
          "32",
          "--ensemble-batch-size",
          "64",
          "--ensemble-max-updates",
          "5000",
          "--ensemble-patience",
          "100000",
          "--ensemble-cache",
          "0"};
}

std::string BytesOf(double value) { return {reinterpret_cast<const char*>(&value), sizeof value}; }

double NumberIn(const std::string& checkpoint, const char* name) {
  CheckpointReader reader = Take(CheckpointReader::Open(checkpoint));
  const double number = reader.Number(name);
  REQUIRE(reader.status().ok());
  return number;
}

}  // namespace

TEST_CASE("A run killed while its ensemble trains goes on there and ends with the same bits") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  const Outcome straight = Run(TrainWords(daemon, "straight"));
  INFO(straight.err);
  REQUIRE(straight.exit_code == 0);

  std::filesystem::create_directories(daemon.folder("killed"));
  FolderWatch watch(daemon.folder("killed"));
  Tool killed(TrainWords(daemon, "killed"));
  REQUIRE(watch.WaitFor("ensemble.h5"));
  killed.Kill();
  REQUIRE_FALSE(std::filesystem::exists(daemon.folder("killed/checkpoint-0.h5")));

  // As if it had been another machine that was killed: the run must name both.
  const std::string record = daemon.folder("killed/run.json");
  const std::string here = "\"" + PresentSession().processor + "\"";
  std::string bytes = ReadBytes(record);
  for (size_t at = 0; (at = bytes.find(here, at)) != std::string::npos;) {
    bytes.replace(at, here.size(), "\"elsewhere\"");
  }
  WriteBytes(record, bytes);

  // As if it had trained for longer than this test can: its cost must say so.
  const std::string model = daemon.folder("killed/ensemble.h5");
  const double spent = NumberIn(model, "seconds");
  REQUIRE(spent > 0);
  bytes = ReadBytes(model);
  const size_t at = bytes.find(BytesOf(spent));
  REQUIRE(at != std::string::npos);
  WriteBytes(model, bytes.replace(at, sizeof spent, BytesOf(9000.0)));

  // Nothing but the folder need be named.
  Tool resumed(
      {"train", "--resume", "--endpoint", daemon.endpoint(), "--out", daemon.folder("killed")});
  CHECK(resumed.WaitForMessage("goes on where it stopped"));
  const Outcome outcome = resumed.Wait();
  INFO(outcome.err);
  REQUIRE(outcome.exit_code == 0);

  const std::vector<RunSession> sessions = Take(ReadRunRecord(daemon.folder("killed"))).sessions;
  REQUIRE(sessions.size() == 2);
  CHECK(sessions[0].processor == "elsewhere");
  CHECK(sessions[1].processor == PresentSession().processor);

  CHECK(NumberIn(daemon.folder("killed/checkpoint-0.h5"), "run/seconds") > 9000);

  const Agent a = Take(ReadAgent(daemon.folder("straight/agent.h5")));
  const Agent b = Take(ReadAgent(daemon.folder("killed/agent.h5")));
  CHECK(a.hidden[0].weight == b.hidden[0].weight);
  CHECK(a.hidden[1].weight == b.hidden[1].weight);
  CHECK(a.last_fc.weight == b.last_fc.weight);
}

TEST_CASE("The command of a run killed while its ensemble trained goes on with it") {
  TestDaemon daemon;
  daemon.MakeDataset("random-v0", 500);
  const Words words = TrainWords(daemon, "killed", "HalfCheetah/random");  // the newest version
  std::filesystem::create_directories(daemon.folder("killed"));
  FolderWatch watch(daemon.folder("killed"));
  Tool killed(words);
  REQUIRE(watch.WaitFor("ensemble.h5"));
  killed.Kill();

  Tool repeated(words);
  CHECK(repeated.WaitForMessage("goes on where it stopped"));
  const Outcome outcome = repeated.Wait();
  INFO(outcome.err);
  CHECK(outcome.exit_code == 0);
}

}  // namespace b4mrl

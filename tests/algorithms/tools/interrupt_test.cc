// Ctrl-C: every command ends with code 130 and a word, and leaves nothing half-made.
#include <sys/prctl.h>
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "client/private_daemon.h"
#include "proto/base/clock.h"
#include "proto/base/folders.h"
#include "tests/algorithms/tools/folder_watch.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/client/fake_daemon.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

void CheckInterrupted(Tool& tool) {
  const Outcome outcome = tool.Wait();
  INFO(outcome.err);
  CHECK(outcome.exit_code == 130);
  CHECK(outcome.err.find("interrupted") != std::string::npos);
  CHECK(outcome.out.empty());
}

TEST_CASE("A command that waits for a daemon ends when it is interrupted") {
  const SocketFolder folder;
  const std::string address = folder.Address();
  const Words agent = {"--agent", B4MRL_SOURCE_DIR "/data/agents/halfcheetah-medium.h5"};
  const std::vector<Words> commands = {
      {"status"},
      {"list", "environments"},
      {"train", "--algorithm", "sac", "--environment", "HalfCheetah", "--out", folder.File("run")},
      {"evaluate", "--environment", "HalfCheetah", agent[0], agent[1]},
      {"dataset", "make", "HalfCheetah/medium"},
      {"dataset", "import", agent[1], "--name", "HalfCheetah/x"},
      {"dataset", "export", "HalfCheetah/x", folder.File("x.h5")},
      {"dataset", "info", "HalfCheetah/x"},
      {"perf", "query"}};
  for (Words words : commands) {
    INFO(words[0]);
    FakeServer silent(address);
    words.insert(words.end(), {"--endpoint", address});
    Tool tool(words);
    REQUIRE(silent.Take(60'000).has_value());  // its Hello
    tool.Signal(SIGINT);
    CheckInterrupted(tool);
  }
}

TEST_CASE("A dataset that is interrupted while it is made leaves nothing behind") {
  const TemporaryFolder data;
  fs::create_directory(data.File("HalfCheetah"));
  FolderWatch watch(data.File("HalfCheetah"));
  Tool tool({"dataset", "make", "HalfCheetah/medium", "--rows", "1e8", "--data", data.path()});
  REQUIRE(watch.WaitFor("medium-v0.h5.b4mrl-tmp"));
  tool.Signal(SIGINT);
  CheckInterrupted(tool);
  CHECK(fs::is_empty(data.File("HalfCheetah")));
}

TEST_CASE("An import that is interrupted while the daemon checks the file leaves no copy") {
  const TemporaryFolder folder;
  const std::string data = folder.File("data");
  fs::create_directory(data);
  WriteBytes(folder.File("file.h5"), "any");
  std::promise<void> asked;
  const FakeDaemon slow([&](FakeServer& server, FakeCall& call) {
    if (call.request.has_open_dataset()) {
      asked.set_value();
      return true;  // no answer
    }
    if (!call.request.has_server_status()) return false;
    pb::Reply reply;
    reply.mutable_server_status()->set_data_folder(data);
    reply.mutable_server_status()->set_data_folder_id(FolderIdentity(data));
    server.Reply(call, std::move(reply));
    return true;
  });
  Tool tool({"dataset", "import", folder.File("file.h5"), "--name", "zz/y", "--endpoint",
             slow.address()});
  REQUIRE(asked.get_future().wait_for(std::chrono::minutes(1)) == std::future_status::ready);
  CHECK(fs::exists(data + "/zz/y.h5"));
  tool.Signal(SIGINT);
  CheckInterrupted(tool);
  CHECK(fs::is_empty(data));
}

TEST_CASE("A command that is killed leaves no temporary folder") {
  const TemporaryFolder folder;
  const std::string temporary = folder.File("tmp");
  fs::create_directory(temporary);
  // Its daemon becomes this process's child, so that its end can be waited for.
  REQUIRE(prctl(PR_SET_CHILD_SUBREAPER, 1) == 0);
  fs::create_directory(folder.File("run"));
  FolderWatch watch(folder.File("run"));
  Tool tool({"train", "--algorithm", "sac", "--environment", "HalfCheetah", "--updates", "1e9",
             "--warm-up", "300", "--hidden-width", "16", "--batch-size", "32", "--out",
             folder.File("run"), "--quiet"},
            {"TMPDIR=" + temporary});
  REQUIRE(watch.WaitFor("checkpoint-0.h5"));
  CHECK_FALSE(fs::is_empty(temporary));
  tool.Kill();
  while (waitpid(-1, nullptr, 0) > 0) {
  }
  prctl(PR_SET_CHILD_SUBREAPER, 0);
  CHECK(fs::is_empty(temporary));
}

TEST_CASE(
    "A training whose daemon was killed ends soon, sooner with Ctrl-C, and tells the way on") {
  PrivateDaemonOptions options;
  options.binary = B4MRL_BINARY_DIR "/b4mrl-serve";
  const TemporaryFolder folder;
  fs::create_directory(folder.File("data"));
  options.data_folder = folder.File("data");  // never the user's own
  Result<PrivateDaemon> daemon = PrivateDaemon::Start(options);
  REQUIRE(daemon.ok());
  const auto train = [&](const std::string& run) {
    fs::create_directory(run);
    FolderWatch watch(run);
    auto tool = std::make_unique<Tool>(Words{"train", "--algorithm", "sac", "--environment",
                                             "HalfCheetah", "--updates", "1e9", "--warm-up", "300",
                                             "--hidden-width", "16", "--batch-size", "32", "--out",
                                             run, "--quiet", "--endpoint", daemon->endpoint()});
    REQUIRE(watch.WaitFor("checkpoint-0.h5"));
    return tool;
  };
  const std::string left = folder.File("left"), interrupted = folder.File("interrupted");
  const auto left_alone = train(left), told_to_end = train(interrupted);
  const Clock::time_point start = Clock::now();
  kill(daemon->process_id(), SIGKILL);
  told_to_end->Signal(SIGINT);
  const Outcome soon = told_to_end->Wait();
  INFO(soon.err);
  CHECK(soon.exit_code == 130);
  CHECK(soon.err.find("interrupted") != std::string::npos);
  CHECK(soon.err.find("continue with --resume --out " + interrupted) != std::string::npos);
  const Outcome lost = left_alone->Wait();
  INFO(lost.err);
  CHECK(lost.exit_code == 4);
  CHECK(lost.err.find("nobody listens at ipc://") != std::string::npos);
  CHECK(lost.err.find("continue with --resume --out " + left) != std::string::npos);
  CHECK(SecondsSince(start) < 60);  // half of the deadline of a learner's request
}

TEST_CASE("A training that a script put into the background outlives the script's Ctrl-C") {
  const TemporaryFolder folder;
  const std::string run = folder.File("run");
  fs::create_directory(run);
  FolderWatch watch(run);
  Tool tool({"train", "--algorithm", "sac", "--environment", "HalfCheetah", "--updates", "50",
             "--warm-up", "300", "--eval-every", "50", "--hidden-width", "16", "--batch-size", "32",
             "--eval-episodes", "1", "--out", run},
            {}, SIG_IGN);
  REQUIRE(watch.WaitFor("result.json"));  // its handlers stand
  tool.Signal(SIGINT);
  const Outcome outcome = tool.Wait();
  INFO(outcome.err);
  CHECK(outcome.exit_code == 0);
  CHECK(outcome.err.find("interrupted") == std::string::npos);
}

TEST_CASE("A computation ends when it is interrupted") {
  Tool tool({"demo", "confounding", "--decisions", "1e9"});
  REQUIRE(tool.WaitUntilItCatchesInterrupts());
  tool.Signal(SIGINT);
  CheckInterrupted(tool);
}

TEST_CASE("A command that is told to end by SIGTERM says so and exits as a shell expects") {
  const SocketFolder folder;
  FakeServer silent(folder.Address());
  Tool tool({"status", "--endpoint", folder.Address()});
  REQUIRE(silent.Take(60'000).has_value());
  tool.Signal(SIGTERM);
  const Outcome outcome = tool.Wait();
  CHECK(outcome.exit_code == 143);
  CHECK(outcome.err.find("interrupted") != std::string::npos);
}

}  // namespace
}  // namespace b4mrl

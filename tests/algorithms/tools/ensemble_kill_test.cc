// kill -9 while an ensemble trains: the run goes on where it stopped, with the same bits.
#include <poll.h>
#include <sys/inotify.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <string>

#include "data/agent_file.h"
#include "tests/algorithms/learners/test_daemon.h"
#include "tests/algorithms/tools/tool.h"

namespace b4mrl {
namespace {

// Returns once a file of this name has been renamed into place in `folder`; false after a minute.
class FolderWatch {
 public:
  explicit FolderWatch(const std::string& folder) : fd_(inotify_init1(IN_CLOEXEC)) {
    REQUIRE(inotify_add_watch(fd_, folder.c_str(), IN_MOVED_TO) >= 0);
  }
  ~FolderWatch() { close(fd_); }

  bool WaitFor(const std::string& name) {
    alignas(inotify_event) std::array<char, 4096> events{};
    for (pollfd wait = {fd_, POLLIN, 0}; poll(&wait, 1, 60'000) == 1;) {
      const ssize_t got = read(fd_, events.data(), events.size());
      for (ssize_t at = 0; at < got;) {
        const auto* event = reinterpret_cast<const inotify_event*>(events.data() + at);
        if (event->len > 0 && name == event->name) return true;
        at += static_cast<ssize_t>(sizeof(inotify_event) + event->len);
      }
    }
    return false;
  }

 private:
  int fd_;
};

Words TrainWords(const TestDaemon& daemon, const std::string& run) {
  return {"train",
          "--algorithm",
          "mopo",
          "--environment",
          "HalfCheetah",
          "--dataset",
          "HalfCheetah/small",
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

  // Nothing but the folder need be named.
  Tool resumed(
      {"train", "--resume", "--endpoint", daemon.endpoint(), "--out", daemon.folder("killed")});
  CHECK(resumed.WaitForMessage("goes on where it stopped"));
  const Outcome outcome = resumed.Wait();
  INFO(outcome.err);
  REQUIRE(outcome.exit_code == 0);

  const Agent a = Take(ReadAgent(daemon.folder("straight/agent.h5")));
  const Agent b = Take(ReadAgent(daemon.folder("killed/agent.h5")));
  CHECK(a.hidden[0].weight == b.hidden[0].weight);
  CHECK(a.hidden[1].weight == b.hidden[1].weight);
  CHECK(a.last_fc.weight == b.last_fc.weight);
}

}  // namespace b4mrl

#include "tests/integration/support/door_clients.h"

#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "tests/integration/support/daemon.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

constexpr uint32_t kGroups = 4;
constexpr uint32_t kLanesPerGroup = 3;
constexpr uint64_t kSeed = 11;
constexpr uint64_t kWalkerSeed = 12;

}  // namespace

PrivateDaemon StartDoorDaemon(std::vector<std::string> flags, bool tcp) {
  flags.insert(flags.begin(), {"--workers", "1", "--threads", "2", "--lease", "30"});
  return StartDaemon({.tcp = tcp, .arguments = std::move(flags)});
}

LaneWalk OpenDoorWalk(Client& client) {
  LaneWalk walk = Take(LaneWalk::Open(client, kGroups, kLanesPerGroup, kSeed));
  RequireOk(walk.Reset());
  return walk;
}

void RequireUndisturbedBytes(const LaneWalk& walk) {
  const uint64_t steps = walk.FinishedSteps();
  CAPTURE(steps);
  REQUIRE(steps > 0);
  PrivateDaemon daemon = StartDoorDaemon({"--no-door"});
  Client client = Connect(daemon.endpoint());
  LaneWalk reference = OpenDoorWalk(client);
  REQUIRE(reference.environment().transport() == "ipc");
  RequireOk(reference.RunTo(steps));
  for (uint32_t lane = 0; lane < kGroups * kLanesPerGroup; ++lane) {
    CAPTURE(lane);
    REQUIRE(walk.Bytes(lane, steps) == reference.Bytes(lane, steps));
  }
}

double WalkBeside(LaneWalk& walk, const std::function<void()>& something) {
  std::atomic<bool> done{false};
  std::thread other([&] {
    something();
    done = true;
  });
  Status status;
  double longest_wait = 0;
  while (!done && status.ok()) {
    const Clock::time_point start = Clock::now();
    status = walk.Advance();
    longest_wait = std::max(longest_wait, SecondsSince(start));
  }
  const uint64_t steps = walk.FinishedSteps();
  other.join();
  INFO(steps << " steps, the longest wait for one: " << longest_wait << " s");
  RequireOk(status);
  RequireOk(walk.Drain());
  return longest_wait;
}

void Pass(double microseconds) {
  const auto nanoseconds = static_cast<int64_t>(microseconds * 1000);
  const timespec length{nanoseconds / 1'000'000'000, nanoseconds % 1'000'000'000};
  ppoll(nullptr, 0, &length, nullptr);
}

Walker::Walker(const std::string& endpoint, std::vector<std::string> before) {
  std::vector<std::string> words = std::move(before);
  words.insert(words.end(),
               {B4MRL_BINARY_DIR "/door_walker", endpoint, std::to_string(kWalkerSeed)});
  const std::string program = words.front();
  is_running_ = StartWithOutput(program, std::move(words), &program_) == 0;
}

void Walker::Signal(int signal) const {
  if (is_running_) kill(program_.process_id, signal);
}

void Walker::End() {
  if (!is_running_) return;
  Signal(SIGKILL);
  while (ReadSome(Deadline::AfterMs(kFirePatienceMs))) {
  }
  waitpid(program_.process_id, nullptr, 0);
  is_running_ = false;
}

bool Walker::AwaitLines(size_t count) {
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  while (lines().size() < count) {
    if (!is_running_ || !ReadSome(deadline)) return false;
  }
  return true;
}

std::vector<std::string> Walker::lines() const {
  std::vector<std::string> lines;
  for (size_t at = 0, end = 0; (end = text_.find('\n', at)) != text_.npos; at = end + 1) {
    lines.push_back(text_.substr(at, end - at));
  }
  return lines;
}

bool Walker::ReadSome(const Deadline& deadline) {
  if (!WaitUntilReady(program_.output.get(), POLLIN, deadline).ok()) return false;
  char bytes[4096];
  const ssize_t count = read(program_.output.get(), bytes, sizeof(bytes));
  if (count > 0) text_.append(bytes, static_cast<size_t>(count));
  return count > 0;
}

UndisturbedWalker::UndisturbedWalker()
    : daemon_(StartDoorDaemon({"--no-door"})),
      client_(Connect(daemon_.endpoint())),
      walk_(Take(LaneWalk::Open(client_, 2, 2, kWalkerSeed))) {
  RequireOk(walk_.Reset());
}

bool UndisturbedWalker::Says(const std::string& line) {
  const uint64_t steps = std::strtoull(line.c_str(), nullptr, 10);
  if (steps > walk_.FinishedSteps()) RequireOk(walk_.RunTo(steps));
  return steps > 0 && line == fmt::format("{} {}", steps, walk_.Hash(steps));
}

Holdings HoldingsOf(pid_t process) {
  Holdings holdings;
  const std::string folder = fmt::format("/proc/{}", process);
  for ([[maybe_unused]] const auto& each : std::filesystem::directory_iterator(folder + "/fd")) {
    ++holdings.descriptors;
  }
  std::ifstream maps(folder + "/maps");
  for (std::string line; std::getline(maps, line);) {
    holdings.doors += line.find("memfd:b4mrl-door") != line.npos ? 1 : 0;
  }
  return holdings;
}

void RequireUnharmed(Client& client, const ProcessView& before, const Holdings& held) {
  const ProcessView worker = LookAt(client, "worker-0");
  REQUIRE(worker.process_id == before.process_id);
  REQUIRE(worker.restarts == before.restarts);
  const Deadline deadline = Deadline::AfterMs(30'000);
  while (HoldingsOf(worker.process_id) != held && !deadline.expired()) std::this_thread::yield();
  const Holdings now = HoldingsOf(worker.process_id);
  CHECK(now.doors == held.doors);
  CHECK(now.descriptors == held.descriptors);
}

}  // namespace b4mrl

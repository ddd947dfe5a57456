// Pictures from a real daemon: they hold up nobody who steps, and survive the death of whoever
// draws or serves them.
#include <poll.h>
#include <signal.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/integration/support/daemon.h"
#include "tests/integration/support/under_fire.h"

namespace b4mrl {
namespace {

// One thread, that of the socket: whatever it waits for, everybody would wait for.
PrivateDaemon Start() { return StartDaemon({.arguments = {"--workers", "1", "--threads", "1"}}); }

RemoteEnvironment Open(Client& client, uint32_t lanes) {
  EnvironmentOptions options;
  options.num_envs = lanes;
  options.seed = 3;
  options.deadline_ms = 120'000;
  Result<RemoteEnvironment> session = client.Make("HalfCheetah", options);
  INFO(session.status().ToString());
  REQUIRE(session.ok());
  REQUIRE(session->Reset().ok());
  return std::move(*session);
}

// The process id of the first process called `name` among the descendants of `ancestor`; 0: none.
pid_t FindDescendant(pid_t ancestor, const std::string& name) {
  std::ifstream file("/proc/" + std::to_string(ancestor) + "/comm");
  std::string own;
  std::getline(file, own);
  if (own == name) return ancestor;
  std::error_code error;
  for (const auto& task :
       std::filesystem::directory_iterator("/proc/" + std::to_string(ancestor) + "/task", error)) {
    std::ifstream children(task.path() / "children");
    for (pid_t child = 0; children >> child;) {
      if (const pid_t found = FindDescendant(child, name); found != 0) return found;
    }
  }
  return 0;
}

std::vector<uint8_t> RenderAll(RemoteEnvironment& session, uint32_t width = 0,
                               uint32_t height = 0) {
  const Result<Pictures> pictures = session.Render({}, width, height);
  INFO(pictures.status().ToString());
  REQUIRE(pictures.ok());
  return {pictures->frames.begin(), pictures->frames.end()};
}

TEST_CASE("Whoever steps does not wait for pictures") {
  PrivateDaemon daemon = Start();
  Result<Client> painted_client = Client::Connect(daemon.endpoint());
  Result<Client> stepping_client = Client::Connect(daemon.endpoint());
  REQUIRE((painted_client.ok() && stepping_client.ok()));
  RemoteEnvironment painted = Open(*painted_client, 64);
  RemoteEnvironment stepping = Open(*stepping_client, 1);
  std::atomic<bool> drawn = false;
  Status status;
  std::thread painter([&] {
    status = painted.Render().status();
    drawn = true;
  });
  // 64 pictures of 480 x 480 take at least half a second, a hundred steps some ten milliseconds.
  const std::vector<float> action(stepping.spec().action.size(), 0.5f);
  bool stepped = true;
  for (int i = 0; i < 100; ++i)
    stepped = stepping.Step(std::span<const float>(action)).ok() && stepped;
  const bool drawn_first = drawn;
  painter.join();
  CHECK(stepped);
  CHECK_FALSE(drawn_first);
  CHECK(status.ok());
}

TEST_CASE("A picture survives the death of its painter, the next request sees to that") {
  PrivateDaemon daemon = Start();
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  RemoteEnvironment session = Open(*client, 2);
  const std::vector<uint8_t> before = RenderAll(session);
  const pid_t worker = LookAt(*client, "worker-0").process_id;
  REQUIRE(worker != 0);
  const pid_t painter = FindDescendant(daemon.process_id(), "b4mrl-render");
  REQUIRE(painter != 0);
  REQUIRE(kill(painter, SIGKILL) == 0);
  // The death may be noticed while the next picture is asked for, and is then that request's error.
  if (!session.Render().ok()) INFO("one request was lost");
  CHECK(RenderAll(session) == before);
  CHECK(LookAt(*client, "worker-0").process_id == worker);
}

TEST_CASE("A picture survives the death of its worker") {
  PrivateDaemon daemon = Start();
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  RemoteEnvironment session = Open(*client, 16);
  const std::vector<uint8_t> before = RenderAll(session);
  const ProcessView worker = LookAt(*client, "worker-0");
  REQUIRE(worker.process_id != 0);
  std::vector<uint8_t> after;
  Status status;
  std::thread renderer([&] {
    const Result<Pictures> pictures = session.Render();  // sent again to the replacement
    status = pictures.status();
    if (pictures.ok()) after.assign(pictures->frames.begin(), pictures->frames.end());
  });
  // It has the request, and 16 pictures take some tenths of a second.
  AwaitRequest(*client, "worker-0", worker);
  kill(worker.process_id, SIGKILL);
  renderer.join();
  INFO(status.ToString());
  REQUIRE(status.ok());
  CHECK(after == before);
  const pid_t replacement = LookAt(*client, "worker-0").process_id;
  REQUIRE(replacement != 0);
  CHECK(replacement != worker.process_id);
}

TEST_CASE("Painters end with their daemon") {
  pid_t painter = 0;
  {
    PrivateDaemon daemon = Start();
    Result<Client> client = Client::Connect(daemon.endpoint());
    REQUIRE(client.ok());
    RemoteEnvironment session = Open(*client, 1);
    RenderAll(session, 32, 32);
    painter = FindDescendant(daemon.process_id(), "b4mrl-render");
    REQUIRE(painter != 0);
    REQUIRE(kill(painter, 0) == 0);
  }
  // Its socket's other end is closed, which it sees once it looks; or an orphan's corpse is left.
  const auto gone = [painter] {
    std::ifstream file("/proc/" + std::to_string(painter) + "/stat");
    std::string id, name, state;
    return !(file >> id >> name >> state) || state == "Z";
  };
  const Deadline deadline = Deadline::AfterMs(10'000);
  while (!gone() && !deadline.expired()) poll(nullptr, 0, 1);
  CHECK(gone());
}

}  // namespace
}  // namespace b4mrl

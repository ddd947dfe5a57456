// model=FILE.xml over the wire: files dropped into the models folder are found, sessions keep the
// model that they were opened with, and a bad file disturbs nobody.
#include <signal.h>

#include <catch2/catch.hpp>
#include <filesystem>

#include "tests/data/temporary_folder.h"
#include "tests/integration/support/cells.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

// HalfCheetah's own model under another gravity.
std::string ModelWithGravity(const std::string& gravity) {
  std::string text = ReadBytes(B4MRL_SOURCE_DIR "/data/models/half_cheetah.xml");
  const std::string before = "0 0 -9.81";
  return text.replace(text.find(before), before.size(), "0 0 " + gravity);
}

// A daemon with an empty models folder of its own.
struct Daemon {
  Daemon() : models(folder.File("models")) {
    std::filesystem::create_directories(models);
    daemon.emplace(
        StartDaemon({.data_folder = folder.path(),
                     .arguments = {"--workers", "1", "--threads", "1", "--models", models}}));
    client.emplace(Connect(daemon->endpoint()));
  }
  void Drop(const std::string& file, const std::string& text) const {
    WriteBytes(models + "/" + file, text);
  }
  Result<RemoteEnvironment> TryOpen(const std::string& perturbations) {
    EnvironmentOptions options;
    options.simulator = Take(ParseNamedArguments(perturbations));
    options.seed = 4;
    options.observation_dtype = DType::kFloat64;
    options.deadline_ms = 60'000;
    return client->Make("HalfCheetah", options);
  }
  RemoteEnvironment Open(const std::string& perturbations) {
    RemoteEnvironment environment = Take(TryOpen(perturbations));
    RequireOk(environment.Reset().status());
    return environment;
  }
  std::vector<std::string> ListedModels() {
    const pb::CatalogueReply catalogue = Take(client->Catalogue());
    for (const pb::PerturbationInfo& info : catalogue.perturbations()) {
      if (info.name() == "model") return {info.files().begin(), info.files().end()};
    }
    return {};
  }
  void KillWorker() {
    const pb::ServerStatusReply status = Take(client->ServerStatus());
    for (const pb::WorkerStatus& worker : status.workers()) {
      if (worker.role() == "worker-0") kill(static_cast<pid_t>(worker.process_id()), SIGKILL);
    }
  }

  TemporaryFolder folder;
  std::string models;
  std::optional<PrivateDaemon> daemon;
  std::optional<Client> client;
};

// Steps `first` to `first + count` of a walk.
std::string Walk(RemoteEnvironment& environment, uint64_t first, uint64_t count) {
  std::string bytes;
  for (uint64_t step = first; step < first + count; ++step) {
    const auto outcome = Take(environment.Step(WalkAction(environment.spec(), 1, step)));
    bytes += BytesOfStep(outcome, 0, environment.spec());
  }
  return bytes;
}

TEST_CASE("A file dropped into the models folder is listed and can be opened") {
  Daemon daemon;
  CHECK(daemon.ListedModels().empty());
  daemon.Drop("moon.xml", ModelWithGravity("-19.62"));
  CHECK(daemon.ListedModels() == std::vector<std::string>{"moon.xml"});
  RemoteEnvironment model = daemon.Open("model=moon.xml");
  RemoteEnvironment gravity = daemon.Open("gravity=2");  // from the task's own model
  CHECK((Walk(model, 0, 50) == Walk(gravity, 0, 50)));
  CHECK(model.experiment_id() != gravity.experiment_id());
  REQUIRE(model.in_force().perturbations_size() == 1);
  CHECK(model.in_force().perturbations(0).argument() == "moon.xml");
}

TEST_CASE("A file named like a task's own replaces nothing, and no worker reads it") {
  Daemon daemon;
  const std::string own = ReadBytes(B4MRL_SOURCE_DIR "/data/models/half_cheetah.xml");
  daemon.Drop("copy.xml", own);
  SECTION("another gravity") { daemon.Drop("half_cheetah.xml", ModelWithGravity("-1")); }
  SECTION("no model at all") {
    daemon.Drop("half_cheetah.xml", "<mujoco><size nstack='2000000000'/></mujoco>");
  }
  RemoteEnvironment plain = daemon.Open("");
  RemoteEnvironment copy = daemon.Open("model=copy.xml");
  CHECK((Walk(plain, 0, 20) == Walk(copy, 0, 20)));
  const pb::ServerStatusReply status = Take(daemon.client->ServerStatus());
  for (const pb::WorkerStatus& worker : status.workers()) CHECK(worker.restarts() == 0);
}

TEST_CASE("A session keeps its model when the file changes and its worker dies") {
  Daemon daemon;
  daemon.Drop("mine.xml", ModelWithGravity("-5"));
  RemoteEnvironment before = daemon.Open("model=mine.xml");
  const std::string reference = Walk(before, 0, 60);
  RemoteEnvironment running = daemon.Open("model=mine.xml");
  CHECK(running.experiment_id() == before.experiment_id());
  std::string walk = Walk(running, 0, 20);
  daemon.Drop("mine.xml", ModelWithGravity("-4"));
  walk += Walk(running, 20, 20);
  daemon.KillWorker();
  walk += Walk(running, 40, 20);
  CHECK((walk == reference));
  RemoteEnvironment after = daemon.Open("model=mine.xml");
  CHECK(after.experiment_id() != running.experiment_id());
  CHECK((Walk(after, 0, 60) != reference));
}

TEST_CASE("A bad file is refused with its line while other sessions go on") {
  Daemon daemon;
  RemoteEnvironment other = daemon.Open("");
  daemon.Drop("bad.xml", "<mujoco>\n<worldbody>\n<geom sise='1'/></worldbody></mujoco>");
  daemon.Drop("thief.xml", "<mujoco>\n<include file='../../../../../etc/passwd'/></mujoco>");
  daemon.Drop("bomb.xml", "<mujoco><size nstack='2000000000'/></mujoco>");
  for (const auto& [file, named] : {std::pair{"bad.xml", "line 3"},
                                    {"thief.xml", "thief.xml, line 2"},
                                    {"bomb.xml", "bomb.xml"},
                                    {"missing.xml", "missing.xml"}}) {
    const auto refused = daemon.TryOpen(std::string("model=") + file);
    INFO(refused.status().ToString());
    CHECK_FALSE(refused.ok());
    CHECK_THAT(refused.status().message(), Catch::Contains(named));
    Walk(other, 0, 5);
  }
  const pb::ServerStatusReply status = Take(daemon.client->ServerStatus());
  for (const pb::WorkerStatus& worker : status.workers()) CHECK(worker.restarts() == 0);
  // Corrected, it is taken at once.
  daemon.Drop("bad.xml", ModelWithGravity("-9"));
  CHECK(daemon.TryOpen("model=bad.xml").ok());
}

TEST_CASE("A model can be queried and photographed like the task's own") {
  Daemon daemon;
  daemon.Drop("mine.xml", ModelWithGravity("-19.62"));
  RemoteEnvironment model = daemon.Open("model=mine.xml,obs-noise=0.01");
  RemoteEnvironment gravity = daemon.Open("gravity=2,obs-noise=0.01");
  const std::vector<double> observations(17, 0.1), actions(6, 0.2);
  std::vector<double> from_model(17), from_gravity(17), reward(1);
  std::vector<uint8_t> terminated(1), valid(1);
  RequireOk(model.Query(observations, actions, {from_model, reward, terminated, valid}, 1, 0, 0));
  RequireOk(
      gravity.Query(observations, actions, {from_gravity, reward, terminated, valid}, 1, 0, 0));
  CHECK(from_model == from_gravity);
  Walk(model, 0, 10);
  const LaneStates states = Take(model.Snapshot());
  const std::string reference = Walk(model, 10, 10);
  RemoteEnvironment other = daemon.Open("model=mine.xml,obs-noise=0.01");
  RequireOk(other.Restore(states).status());
  CHECK((Walk(other, 10, 10) == reference));
}

}  // namespace
}  // namespace b4mrl

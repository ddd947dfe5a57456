#include "server/environments/mujoco/mujoco_guard.h"

#include <catch2/catch.hpp>
#include <cstring>
#include <nlohmann/json.hpp>
#include <thread>

#include "server/environments/list.h"
#include "server/environments/mujoco/mujoco_environment.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

LoadedModel LoadHalfCheetah() {
  return Take(LoadMujocoModel({Config::object(), {}}, "half_cheetah.xml"));
}

TEST_CASE("A guarded engine error comes back as false with its message") {
  InstallMujocoHandlers();
  REQUIRE_FALSE(RunGuarded([](void*) { mju_error("engine says no"); }, nullptr));
  REQUIRE(std::strstr(LastMujocoError(), "engine says no") != nullptr);
  bool ran = false;
  REQUIRE(RunGuarded([](void* flag) { *static_cast<bool*>(flag) = true; }, &ran));
  REQUIRE(ran);
}

TEST_CASE("Guards of different threads do not meet") {
  InstallMujocoHandlers();
  int caught[2] = {0, 0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 2; ++t) {
    threads.emplace_back([&caught, t] {
      for (int i = 0; i < 1000; ++i) {
        caught[t] += !RunGuarded([](void*) { mju_error("no"); }, nullptr);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  REQUIRE(caught[0] == 1000);
  REQUIRE(caught[1] == 1000);
}

TEST_CASE("An engine that runs out of memory in a step ends the episode, not the process") {
  const LoadedModel loaded = LoadHalfCheetah();
  loaded.model->nstack = 100;  // far below what a step needs
  const MjDataPtr data = Take(MakeMujocoData(*loaded.model));
  struct Call {
    const mjModel* model;
    mjData* data;
  } call{loaded.model.get(), data.get()};
  const auto step = [](void* argument) {
    auto* c = static_cast<Call*>(argument);
    mj_step(c->model, c->data);
  };
  REQUIRE_FALSE(RunGuarded(step, &call));
  REQUIRE(std::strstr(LastMujocoError(), "Stack overflow") != nullptr);
  // What MujocoEnvironment relies on: a reset frees the engine's stack.
  mj_resetData(loaded.model.get(), data.get());
  REQUIRE(data->pstack == 0);
}

TEST_CASE("Warnings are counted once") {
  const LoadedModel loaded = LoadHalfCheetah();
  const MjDataPtr data = Take(MakeMujocoData(*loaded.model));
  data->qpos[3] = 1e11;  // beyond mjMAXVAL
  mj_step(loaded.model.get(), data.get());
  REQUIRE(TakeWarnings(data.get()) == 1);
  REQUIRE(TakeWarnings(data.get()) == 0);
}

}  // namespace
}  // namespace b4mrl

// A models folder and a cache for tests that compile users' models, in the real program.
#pragma once

#include <filesystem>
#include <memory>
#include <set>
#include <string>

#include "proto/base/limits.h"
#include "server/environments/mujoco/compiled_model.h"
#include "server/models/model_compiler.h"
#include "tests/server/environments/simulation.h"
#include "tests/server/models/model_fixture.h"

namespace b4mrl {

struct Folders {
  Folders() : models(folder.File("models")), cache(folder.File("cache")) {
    std::filesystem::create_directories(models);
    std::filesystem::create_directories(cache);
  }
  Result<std::string> Compile(const std::string& file, const std::string& environment) const {
    return CompileModelInChild(B4MRL_BINARY_DIR "/b4mrl-serve", {models, file, environment, cache},
                               Deadline::AfterMs(limits::kModelCompilerMs));
  }
  Result<std::string> CompileText(const std::string& text,
                                  const std::string& environment = "Hopper") const {
    WriteBytes(models + "/model.xml", text);
    return Compile("model.xml", environment);
  }
  // The simulator of the file that was compiled with this hash. `perturbations` as on the command
  // line.
  Result<std::shared_ptr<const Simulator>> TryOpen(
      const std::string& environment, const std::string& hash,
      const std::string& perturbations = "model=model.xml", const std::string& config = "") const {
    return Simulator::Open({environment,
                            Take(ParseNamedArguments(perturbations)),
                            config,
                            {CompiledModelPath(cache, hash), hash}});
  }
  std::set<std::string> CacheFiles() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(cache)) {
      names.insert(entry.path().filename());
    }
    return names;
  }

  TemporaryFolder folder;
  std::string models, cache;
};

// The digest of a walk: equal digests mean equal trajectories.
inline uint64_t Walk(const std::shared_ptr<const Simulator>& simulator) {
  TestLane lane(simulator);
  lane.Reset(3);
  for (uint64_t k = 0; k < 100; ++k) lane.StepRandomly(k);
  return lane.header().digest;
}

}  // namespace b4mrl

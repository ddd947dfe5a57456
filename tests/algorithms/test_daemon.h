// A private daemon with an own data folder, and small things to train on. For tests.
#pragma once

#include <catch2/catch.hpp>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <utility>

#include "algorithms/base/progress.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/episodes/behaviour.h"
#include "algorithms/episodes/collect.h"
#include "algorithms/episodes/recorder.h"
#include "algorithms/policy/agent_policy.h"
#include "client/client.h"
#include "client/private_daemon.h"
#include "data/d4rl/dataset_file_writer.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {

class TestDaemon {
 public:
  explicit TestDaemon(std::vector<std::string> arguments = {})
      : daemon_(Take(PrivateDaemon::Start(Options(std::move(arguments))))),
        client_(Take(Client::Connect(daemon_.endpoint()))) {
    setenv("XDG_CACHE_HOME", folder("cache").c_str(), 1);  // of learners, not the user's
  }

  Client& client() { return client_; }
  const std::string& endpoint() const { return daemon_.endpoint(); }
  std::string folder(const std::string& name) const { return folder_.File(name); }

  // A stochastic policy with random weights, as an agent.
  static Agent RandomAgent() {
    SacOptions options;
    options.observation_size = 17;
    options.action_size = 6;
    options.hidden = {16, 16};
    options.seed = 5;
    const std::vector<float> scale(6, 1.0f);
    return MakeAgent(Take(SacCore<float>::Create(options)).Policy(), 1, scale);
  }

  // "HalfCheetah/<name>" with so many rows of that policy; returns the file.
  std::string MakeDataset(const std::string& name, uint64_t rows, uint64_t seed = 0,
                          uint32_t lanes_max = 64) {
    std::filesystem::create_directories(folder("data/HalfCheetah"));
    const std::string path = folder("data/HalfCheetah/" + name + ".h5");
    DatasetWriterOptions options;
    options.observation_dimensions = 17;
    options.action_dimensions = 6;
    options.action_log_probs = true;
    Recorder recorder = Take(Recorder::Create(path, options));
    Progress quiet(true);
    const EnvironmentSpec environment = Take(client_.FindEnvironment("HalfCheetah"));
    const Behaviour behaviour = Take(Behaviour::OfAgent(RandomAgent(), environment));
    CollectOptions collect;
    collect.environment = environment.name;
    collect.rows = rows;
    collect.seed = seed;
    collect.lanes_max = lanes_max;
    RequireOk(Collect(collect, behaviour, client_, recorder, quiet));
    RequireOk(recorder.writer().Commit());
    return path;
  }

 private:
  PrivateDaemonOptions Options(std::vector<std::string> arguments) {
    PrivateDaemonOptions options;
    options.binary = B4MRL_BINARY_DIR "/b4mrl-serve";
    options.data_folder = folder("data");
    options.arguments = std::move(arguments);
    std::filesystem::create_directories(options.data_folder);
    return options;
  }

  TemporaryFolder folder_;
  PrivateDaemon daemon_;
  Client client_;
};

}  // namespace b4mrl

// A benchmark as one object: its two flawed sources of experience, and its evaluation.
//
//   auto bench = client->FindBenchmark("HalfCheetah/confounding/hidden-high+medium-expert");
//   auto simulator = bench->MakeSimulator({.num_envs = 8});  // num_envs 0: for queries alone
//   auto data = bench->OpenDataset();
//   auto scores = bench->Evaluate(policy, {.episodes = 10});
//
// Errors are those of client/client.h, and kFailedPrecondition for the dataset of a benchmark that
// has none. Thread rule: one thread at a time; it uses its Client, which must outlive it and must
// not be moved. Sessions and datasets that it opens are independent of it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/evaluation.h"
#include "client/remote_dataset.h"
#include "client/remote_environment.h"
#include "proto/b4mrl.pb.h"
#include "proto/base/limits.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

class Client;

struct EvaluationOptions {
  enum class Observe {
    kTrained,  // what RemoteBenchmark::Mask hides is 0
    kFull,     // nothing is hidden
    kServed,   // as kTrained, with the noise that the training's observations had
  };
  uint32_t episodes = 10;
  // Other starts than those of the evaluations during training: seed 1 of `b4mrl evaluate`, else 0.
  bool held_out = false;
  Observe observe = Observe::kTrained;
  int64_t deadline_ms = limits::kDefaultDeadlineMs;  // of each request
};

// What the daemon has counted for a benchmark: the entry "ledger" of a result's file.
struct BenchmarkUse {
  uint64_t simulator_steps = 0;
  uint64_t query_rows = 0;
  uint64_t dataset_rows = 0;
  uint64_t evaluation_episodes = 0;
};

class RemoteBenchmark {
 public:
  // The catalogue's entry: suite, simulator, dataset, corruption, world and the paper's scores.
  const pb::BenchmarkInfo& info() const { return info_; }
  const std::string& name() const { return info_.name(); }
  const EnvironmentSpec& environment() const { return environment_; }

  // A session of the flawed simulator. kInvalidArgument if `options` name a simulator or a
  // ledger.
  Result<RemoteEnvironment> MakeSimulator(EnvironmentOptions options = {});
  // The corrupted dataset. kInvalidArgument if `options` name a corruption or a ledger;
  // kUnknownName if the daemon's data folder lacks the dataset, which `b4mrl dataset make` makes.
  Result<RemoteDataset> OpenDataset(DatasetOptions options = {});

  // For each dimension of an observation: 1 if a policy may see it in evaluations, 0 if it sees 0
  // instead. Hidden is what the training hid: dimensions that the dataset hides or that its
  // behaviour policy could not see; in a benchmark without a dataset, those that the simulator
  // hides. The first call opens the dataset or the simulator.
  Result<std::vector<uint8_t>> Mask();

  // Scores a policy in the benchmark's world: the true environment, with the perturbations
  // info().world(). Equal policies have returns equal to those of `b4mrl evaluate`, bit for bit.
  // kInvalidArgument: no episodes, or kServed where the training's observations have no noise.
  Result<EvaluationResult> Evaluate(const BatchPolicy& policy,
                                    const EvaluationOptions& options = {});

  // What its simulators, datasets and evaluations have used since it was found or, where it was
  // found with a ledger, since that was opened.
  Result<BenchmarkUse> Use();

 private:
  friend class Client;
  // What the training's policy observes.
  struct Training {
    std::vector<uint8_t> mask;
    std::vector<NamedArgument> noise;
  };
  RemoteBenchmark(Client* client, pb::BenchmarkInfo info, EnvironmentSpec environment,
                  uint64_t ledger);

  Result<Training> ReadTraining();
  // The dataset, with the benchmark's corruption.
  Result<RemoteDataset> OpenOwnDataset(DatasetOptions options);
  // The training as it was read at the first call.
  Result<Training> KnownTraining();
  // The number of a ledger, which is opened at the first call.
  Result<uint64_t> Opened(uint64_t* ledger);

  Client* client_;
  pb::BenchmarkInfo info_;
  EnvironmentSpec environment_;
  uint64_t learning_ledger_;  // 0: not opened yet
  uint64_t evaluation_ledger_ = 0;
  std::optional<Training> training_;
};

}  // namespace b4mrl

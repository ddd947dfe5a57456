// A learner of one's own for the benchmarks: behaviour cloning by a linear policy.
//
//   b4mrl benchmark run 'HalfCheetah/confounding/*' --learner build/release/own_learner --name lms
//
// The runner starts this program once for each benchmark and seed. An update is one row of the
// dataset and one step of least mean squares, normalised by the length of the observation. After
// each fifth of its updates the policy is scored, for the curve.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "client/benchmark_run.h"
#include "client/client.h"

using b4mrl::Result;
using b4mrl::Status;

// actions += weights x observation
void Predict(const std::vector<float>& weights, std::span<const float> observation,
             std::span<float> action) {
  const size_t size = observation.size();
  for (size_t i = 0; i < action.size(); ++i) {
    for (size_t j = 0; j < size; ++j) action[i] += weights[i * size + j] * observation[j];
  }
}

Status WriteFile(const std::string& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  if (file.flush()) return Status();
  return Status(b4mrl::StatusCode::kIoError, "cannot write " + path);
}

Status Learn(const b4mrl::BenchmarkRun& run) {
  B4MRL_ASSIGN_OR_RETURN(b4mrl::Client client, b4mrl::Client::Connect(run.endpoint));
  B4MRL_ASSIGN_OR_RETURN(b4mrl::RemoteBenchmark bench,
                         client.FindBenchmark(run.benchmark, run.ledger));
  B4MRL_ASSIGN_OR_RETURN(b4mrl::RemoteDataset data, bench.OpenDataset());
  const size_t size = data.observation_size(), action_size = data.action_size();
  std::vector<float> weights(size * action_size);
  b4mrl::BatchStream batches = data.Stream(/*rows=*/1, run.seed);
  const auto policy = [&](const b4mrl::PolicyBatch& batch) {
    std::ranges::fill(batch.actions, 0.0f);
    for (size_t i = 0; i < batch.episodes.size(); ++i) {
      Predict(weights, batch.observations.subspan(i * size, size),
              batch.actions.subspan(i * action_size, action_size));
    }
    return Status();
  };
  std::vector<std::string> curve;
  for (uint64_t update = 1; update <= run.updates; ++update) {
    B4MRL_ASSIGN_OR_RETURN(const b4mrl::TransitionRows row, batches.Next());
    std::vector<float> error(action_size);
    Predict(weights, row.observations, error);
    float length = 1;
    for (const float value : row.observations) length += value * value;
    for (size_t i = 0; i < weights.size(); ++i) {
      weights[i] -=
          0.1f * (error[i / size] - row.actions[i / size]) * row.observations[i % size] / length;
    }
    if (update % std::max<uint64_t>(run.updates / 5, 1) != 0 || update == run.updates) continue;
    B4MRL_ASSIGN_OR_RETURN(const b4mrl::EvaluationResult scores, bench.Evaluate(policy));
    curve.push_back(fmt::format("{{\"updates\": {}, \"returns\": [{}]}}", update,
                                fmt::join(scores.returns, ", ")));
  }
  B4MRL_ASSIGN_OR_RETURN(const b4mrl::EvaluationResult scores, bench.Evaluate(policy));
  B4MRL_RETURN_IF_ERROR(WriteFile(run.out + "/returns.json",
                                  fmt::format("{{\"returns\": [{}], \"updates\": {}}}\n",
                                              fmt::join(scores.returns, ", "), run.updates)));
  return WriteFile(run.out + "/curve.json",
                   fmt::format("{{\"curve\": [{}]}}\n", fmt::join(curve, ", ")));
}

int main() {
  const Result<b4mrl::BenchmarkRun> run = b4mrl::ReadBenchmarkRun();
  const Status status = run.ok() ? Learn(*run) : run.status();
  if (!status.ok()) fmt::print(stderr, "{}\n", status.ToString());
  return status.ok() ? 0 : 1;
}

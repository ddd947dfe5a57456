#include "algorithms/rl/model_rollout.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "algorithms/learner.h"
#include "proto/base/rng.h"

namespace b4mrl {

// The rows [first_row, first_row + rows) of a cycle, at one step of their way. Columns are rows.
struct ModelRollout::Chunk {
  Chunk(const ModelRolloutOptions& options, int first, int count)
      : first_row(first),
        rows(count),
        alive(count, 1),
        inputs(options.observation_size + options.action_size, count),
        scaled_actions(options.action_size, count),
        outputs(options.observation_size + 1, count),
        simulated(options.observation_size, count),
        simulator_rewards(count),
        terminated(count),
        valid(count),
        penalties(count) {}

  MatrixView<float> observations() { return inputs.view().RowBlock(0, outputs.rows() - 1); }
  MatrixView<float> actions() {
    return inputs.view().RowBlock(outputs.rows() - 1, scaled_actions.rows());
  }

  int first_row;
  int rows;
  int step = 0;
  uint64_t request = 0;
  std::vector<uint8_t> alive;          // 0 after a dropped or terminated step
  MatrixBuffer<float> inputs;          // o above a, as the ensemble takes them
  MatrixBuffer<float> scaled_actions;  // a in the environment's units
  MatrixBuffer<float> outputs;         // delta above r
  MatrixBuffer<float> simulated;       // o'_sim, then o'
  std::vector<double> simulator_rewards;
  std::vector<uint8_t> terminated, valid;
  AlignedVector<float> penalties;
  // Of all steps so far: o, a, o', r, terminated, one after the other.
  std::vector<float> records;
  RolloutCounts counts;
};

ModelRollout::ModelRollout(ModelRolloutOptions options, RemoteEnvironment* simulator,
                           DynamicsEnsemble<float>* ensemble)
    : options_(std::move(options)), simulator_(simulator), ensemble_(ensemble) {}

ModelRollout::~ModelRollout() = default;

Status ModelRollout::Begin(uint64_t cycle, std::vector<float> starts, const PolicyWeights& policy) {
  B4MRL_ASSIGN_OR_RETURN(FixedOrderPolicy network, FixedOrderPolicy::Create(policy));
  policy_.emplace(std::move(network));
  starts_ = std::move(starts);
  cycle_ = cycle;
  next_start_ = 0;
  finished_.clear();
  return Fill();
}

// Keeps `chunks_in_flight` chunks at the daemon while there are start rows left.
Status ModelRollout::Fill() {
  const int total = static_cast<int>(starts_.size()) / options_.observation_size;
  while (static_cast<int>(active_.size()) < options_.chunks_in_flight && next_start_ < total) {
    const int rows = std::min(options_.chunk_rows, total - next_start_);
    auto chunk = std::make_unique<Chunk>(options_, next_start_, rows);
    for (int i = 0; i < rows; ++i) {
      std::copy_n(starts_.data() + static_cast<size_t>(next_start_ + i) * options_.observation_size,
                  options_.observation_size, chunk->observations().column(i));
    }
    next_start_ += rows;
    B4MRL_RETURN_IF_ERROR(SendStep(*chunk));
    active_.push_back(std::move(chunk));
  }
  return Status();
}

// Every row has its own place in the stream of (cycle, step), dropped rows included.
void ModelRollout::DrawNoise(const char* purpose, const Chunk& chunk,
                             MatrixView<float> noise) const {
  Rng rng(RoleSeed(options_.seed, purpose, cycle_), "rollout", static_cast<uint64_t>(chunk.step));
  rng.Seek(static_cast<uint64_t>(chunk.first_row) * noise.rows);
  for (int column = 0; column < noise.columns; ++column) {
    rng.FillNormal(std::span(noise.column(column), static_cast<size_t>(noise.rows)));
  }
}

Status ModelRollout::SendStep(Chunk& chunk) {
  const int action_size = options_.action_size;
  MatrixBuffer<float> noise(action_size, chunk.rows);
  DrawNoise("action", chunk, noise.view());
  MatrixBuffer<float> observations(options_.observation_size, chunk.rows);
  for (int column = 0; column < chunk.rows; ++column) {
    std::copy_n(chunk.observations().column(column), options_.observation_size,
                observations.view().column(column));
  }
  policy_->Sample(observations.view(), noise.view(), chunk.scaled_actions.view());
  for (int column = 0; column < chunk.rows; ++column) {
    for (int i = 0; i < action_size; ++i) {
      chunk.actions()(i, column) = chunk.scaled_actions.view()(i, column);
      chunk.scaled_actions.view()(i, column) *= options_.action_scale[i];
    }
  }
  // Draw 0 is the pre-pass over the dataset.
  const uint64_t draw = 1 + cycle_ * static_cast<uint64_t>(options_.horizon) + chunk.step;
  B4MRL_ASSIGN_OR_RETURN(
      chunk.request,
      simulator_->SendQuery(observations.values(), chunk.scaled_actions.values(),
                            RoleSeed(options_.seed, "simulator"), draw, chunk.first_row));
  SampleCorrection(chunk);  // while the daemon simulates
  return Status();
}

void ModelRollout::SampleCorrection(Chunk& chunk) {
  MatrixBuffer<float> noise(chunk.outputs.rows(), chunk.rows);
  DrawNoise("model", chunk, noise.view());
  const std::vector<int> elites = ensemble_->Elites();
  Rng rng(RoleSeed(options_.seed, "member", cycle_), "rollout", static_cast<uint64_t>(chunk.step));
  rng.Seek(static_cast<uint64_t>(chunk.first_row));
  std::vector<int> members(chunk.rows);
  for (int& member : members) member = elites[rng.Below(elites.size())];
  std::span<float> penalties;
  if (options_.penalty != 0) penalties = chunk.penalties;
  ensemble_->Sample(chunk.inputs.view(), members, noise.view(), chunk.outputs.view(), penalties);
}

Status ModelRollout::Advance() {
  if (active_.empty()) return Status();
  // The oldest request is the likeliest to be answered. All chunks take equally many turns, so they
  // also end in the order in which they began.
  std::unique_ptr<Chunk> chunk = std::move(active_.front());
  active_.pop_front();
  B4MRL_RETURN_IF_ERROR(ReceiveStep(*chunk));
  if (++chunk->step < options_.horizon) {
    B4MRL_RETURN_IF_ERROR(SendStep(*chunk));
    active_.push_back(std::move(chunk));
    return Status();
  }
  finished_.push_back(std::move(chunk));
  return Fill();
}

Status ModelRollout::ReceiveStep(Chunk& chunk) {
  const QueryOutput output = {chunk.simulated.values(), chunk.simulator_rewards, chunk.terminated,
                              chunk.valid};
  B4MRL_RETURN_IF_ERROR(simulator_->ReceiveQuery(chunk.request, output));
  ApplyCorrection(chunk);
  return Status();
}

void ModelRollout::ApplyCorrection(Chunk& chunk) {
  const int size = options_.observation_size;
  for (int row = 0; row < chunk.rows; ++row) {
    if (chunk.alive[row] == 0) continue;
    float* next = chunk.simulated.view().column(row);
    const float* correction = chunk.outputs.view().column(row);
    float reward = correction[size];
    if (options_.penalty != 0)
      reward -= static_cast<float>(options_.penalty) * chunk.penalties[row];
    bool finite = chunk.valid[row] != 0 && std::isfinite(reward);
    for (int i = 0; i < size; ++i) {
      next[i] += correction[i];
      if (!options_.mask.empty()) next[i] *= options_.mask[i];
      finite = finite && std::isfinite(next[i]);
    }
    if (!finite) {
      chunk.alive[row] = 0;
      ++chunk.counts.invalid_rows;
      continue;
    }
    const float* input = chunk.inputs.view().column(row);
    chunk.records.insert(chunk.records.end(), input, input + chunk.inputs.rows());
    chunk.records.insert(chunk.records.end(), next, next + size);
    chunk.records.push_back(reward);
    chunk.records.push_back(chunk.terminated[row] != 0 ? 1.0f : 0.0f);
    ++chunk.counts.rows;
    chunk.counts.reward_sum += reward;
    if (chunk.terminated[row] != 0) chunk.alive[row] = 0;
    std::copy_n(next, size, chunk.observations().column(row));
  }
}

Result<RolloutCounts> ModelRollout::Finish(ReplayBuffer& pool) {
  while (!done()) B4MRL_RETURN_IF_ERROR(Advance());
  const size_t size = options_.observation_size, actions = options_.action_size;
  RolloutCounts counts;
  for (const auto& chunk : finished_) {
    std::span<const float> rest = chunk->records;
    while (!rest.empty()) {
      B4MRL_RETURN_IF_ERROR(pool.Append({.observation = rest.subspan(0, size),
                                         .action = rest.subspan(size, actions),
                                         .next_observation = rest.subspan(size + actions, size),
                                         .reward = rest[2 * size + actions],
                                         .terminated = rest[2 * size + actions + 1] != 0}));
      rest = rest.subspan(2 * size + actions + 2);
    }
    counts.rows += chunk->counts.rows;
    counts.invalid_rows += chunk->counts.invalid_rows;
    counts.reward_sum += chunk->counts.reward_sum;
  }
  finished_.clear();
  return counts;
}

}  // namespace b4mrl

#include "algorithms/model/model_rollout.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "algorithms/base/learner.h"
#include "algorithms/base/within_memory.h"
#include "proto/base/rng.h"

namespace b4mrl {

// The rollouts of the start rows [first_row, first_row + places), all at the same step. The first
// `rows` columns are the rollouts that have not ended, in the order of their start rows.
struct ModelRollout::Chunk {
  Chunk(const ModelRolloutOptions& options, int first, int places)
      : first_row(first),
        rows(places),
        start_rows(places),
        inputs(options.observation_size + options.action_size, places),
        outputs(options.observation_size + 1, places),
        next(options.observation_size, places),
        simulator_rewards(places),
        terminated(places),
        valid(places, 1),
        penalties(places) {
    std::iota(start_rows.begin(), start_rows.end(), first);
  }

  int observation_size() const { return next.rows(); }
  MatrixView<float> observations() { return inputs.view(rows).RowBlock(0, observation_size()); }
  MatrixView<float> actions() {
    return inputs.view(rows).RowBlock(observation_size(), inputs.rows() - observation_size());
  }

  int first_row;
  int rows;
  int step = 0;
  uint64_t request = 0;
  std::vector<int> start_rows;  // number of each column's start row
  MatrixBuffer<float> inputs;   // the ensemble's inputs: each column holds o, then a
  MatrixBuffer<float> outputs;  // each column holds delta, then r
  MatrixBuffer<float> next;     // o'_sim (MOPO: o), then o'
  std::vector<double> simulator_rewards;
  std::vector<uint8_t> terminated, valid;  // flags of the simulator's reply
  AlignedVector<float> penalties;
  // The transitions of all steps so far: o, a, o', r, terminated, one after the other.
  std::vector<float> records;
  RolloutCounts counts;
};

ModelRollout::ModelRollout(ModelRolloutOptions options, RemoteEnvironment* simulator,
                           DynamicsEnsemble<float>* ensemble)
    : options_(std::move(options)),
      simulator_(simulator),
      ensemble_(ensemble),
      observations_(options_.observation_size, options_.chunk_rows),
      actions_(options_.action_size, options_.chunk_rows),
      action_noise_(options_.action_size, options_.chunk_rows),
      model_noise_(options_.observation_size + 1, options_.chunk_rows),
      members_(options_.chunk_rows) {}

ModelRollout::~ModelRollout() = default;

Status ModelRollout::Begin(uint64_t cycle, std::vector<float> starts, const PolicyWeights& policy) {
  B4MRL_ASSIGN_OR_RETURN(FixedOrderPolicy network, FixedOrderPolicy::Create(policy));
  policy_.emplace(std::move(network));
  starts_ = std::move(starts);
  cycle_ = cycle;
  next_start_ = 0;
  finished_.clear();
  worker_ = std::jthread([this](const std::stop_token& stop) {
    worker_status_ = WithinMemory("rollouts in the model", [&] { return RollOut(stop); });
  });
  return Status();
}

Status ModelRollout::RollOut(const std::stop_token& stop) {
  B4MRL_RETURN_IF_ERROR(Fill());
  while (!active_.empty() && !stop.stop_requested()) B4MRL_RETURN_IF_ERROR(Advance());
  return Status();
}

// Starts chunks until `chunks_in_flight` chunks are under way or no start row is left.
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
    B4MRL_RETURN_IF_ERROR(BeginStep(*chunk));
    active_.push_back(std::move(chunk));
  }
  return Status();
}

Status ModelRollout::BeginStep(Chunk& chunk) {
  SampleActions(chunk);
  if (simulator_ != nullptr) B4MRL_RETURN_IF_ERROR(SendQuery(chunk));
  SampleModel(chunk);  // while the daemon simulates
  return Status();
}

// Draws noise for the chunk's columns. Every start row has a fixed place in the random stream of
// (cycle, step).
void ModelRollout::DrawNoise(const char* purpose, const Chunk& chunk,
                             MatrixView<float> noise) const {
  Rng rng(RoleSeed(options_.seed, purpose, cycle_), "rollout", static_cast<uint64_t>(chunk.step));
  for (int column = 0; column < noise.columns; ++column) {
    rng.Seek(static_cast<uint64_t>(chunk.start_rows[column]) * noise.rows);
    rng.FillNormal(std::span(noise.column(column), static_cast<size_t>(noise.rows)));
  }
}

// Samples a ~ pi(o) for the chunk's columns.
void ModelRollout::SampleActions(Chunk& chunk) {
  const MatrixView<float> noise = action_noise_.view(chunk.rows);
  const MatrixView<float> observations = observations_.view(chunk.rows);
  const MatrixView<float> actions = actions_.view(chunk.rows);
  DrawNoise("action", chunk, noise);
  for (int column = 0; column < chunk.rows; ++column) {
    std::copy_n(chunk.observations().column(column), observations.rows,
                observations.column(column));
  }
  policy_->Sample(observations, noise, actions);
  for (int column = 0; column < chunk.rows; ++column) {
    std::copy_n(actions.column(column), actions.rows, chunk.actions().column(column));
  }
}

// Sends the query for o'_sim = T_sim(o, a), with a in the environment's units.
Status ModelRollout::SendQuery(Chunk& chunk) {
  const size_t rows = chunk.rows;
  const std::span<float> actions = actions_.values().first(rows * options_.action_size);
  for (size_t i = 0; i < actions.size(); ++i) {
    actions[i] *= options_.action_scale[i % options_.action_size];
  }
  // Draws count from 1: another first number would be another run.
  const uint64_t draw = 1 + cycle_ * static_cast<uint64_t>(options_.horizon) + chunk.step;
  B4MRL_ASSIGN_OR_RETURN(
      chunk.request,
      simulator_->SendQuery(observations_.values().first(rows * options_.observation_size), actions,
                            RoleSeed(options_.seed, "simulator"), draw, chunk.first_row));
  return Status();
}

// Samples (delta, r) ~ f_i(o, a) for the chunk's columns.
void ModelRollout::SampleModel(Chunk& chunk) {
  const MatrixView<float> noise = model_noise_.view(chunk.rows);
  DrawNoise("model", chunk, noise);
  const std::vector<int> elites = ensemble_->Elites();
  Rng rng(RoleSeed(options_.seed, "member", cycle_), "rollout", static_cast<uint64_t>(chunk.step));
  const std::span<int> members = std::span(members_).first(chunk.rows);
  for (int column = 0; column < chunk.rows; ++column) {
    rng.Seek(static_cast<uint64_t>(chunk.start_rows[column]));
    members[column] = elites[rng.Below(elites.size())];
  }
  std::span<float> penalties;  // while it is empty, only the drawn members are evaluated
  if (options_.penalty != 0) penalties = std::span(chunk.penalties).first(chunk.rows);
  ensemble_->Sample(chunk.inputs.view(chunk.rows), members, noise, chunk.outputs.view(chunk.rows),
                    penalties);
}

// Completes one step of the chunk whose request is the oldest.
Status ModelRollout::Advance() {
  // The oldest request is the most likely to have been answered.
  std::unique_ptr<Chunk> chunk = std::move(active_.front());
  active_.pop_front();
  B4MRL_RETURN_IF_ERROR(ReceiveNext(*chunk));
  CompleteStep(*chunk);
  if (++chunk->step < options_.horizon && chunk->rows > 0) {
    B4MRL_RETURN_IF_ERROR(BeginStep(*chunk));
    active_.push_back(std::move(chunk));
    return Status();
  }
  finished_.push_back(std::move(chunk));
  return Fill();
}

Status ModelRollout::ReceiveNext(Chunk& chunk) {
  const std::span<float> next =
      chunk.next.values().first(static_cast<size_t>(chunk.rows) * options_.observation_size);
  if (simulator_ != nullptr) {
    const size_t rows = chunk.rows;
    return simulator_->ReceiveQuery(
        chunk.request,
        {next, std::span(chunk.simulator_rewards).first(rows),
         std::span(chunk.terminated).first(rows), std::span(chunk.valid).first(rows)});
  }
  for (int column = 0; column < chunk.rows; ++column) {
    std::copy_n(chunk.observations().column(column), options_.observation_size,
                chunk.next.view().column(column));
  }
  return Status();
}

// Completes a step of all rows of a chunk, and moves the rows whose rollouts continue to the front.
void ModelRollout::CompleteStep(Chunk& chunk) {
  int kept = 0;
  for (int row = 0; row < chunk.rows; ++row) {
    if (!CompleteRow(chunk, row)) continue;
    std::copy_n(chunk.next.view().column(row), options_.observation_size,
                chunk.observations().column(kept));
    chunk.start_rows[kept] = chunk.start_rows[row];
    ++kept;
  }
  chunk.rows = kept;
}

// Computes o' and r~ of one row and records the transition. Returns whether the row's rollout
// continues.
bool ModelRollout::CompleteRow(Chunk& chunk, int row) {
  const int size = options_.observation_size;
  float* next = chunk.next.view().column(row);
  const float* output = chunk.outputs.view().column(row);
  float reward = output[size];
  if (options_.penalty != 0) reward -= static_cast<float>(options_.penalty) * chunk.penalties[row];
  bool finite = chunk.valid[row] != 0 && std::isfinite(reward);
  for (int i = 0; i < size; ++i) {
    next[i] += output[i];
    if (!options_.mask.empty()) next[i] *= options_.mask[i];
    finite = finite && std::isfinite(next[i]);
  }
  if (!finite) {
    ++chunk.counts.invalid_rows;
    return false;
  }
  const bool terminated = options_.termination
                              ? options_.termination->Ends({next, static_cast<size_t>(size)})
                              : chunk.terminated[row] != 0;
  const float* input = chunk.inputs.view().column(row);
  chunk.records.insert(chunk.records.end(), input, input + chunk.inputs.rows());
  chunk.records.insert(chunk.records.end(), next, next + size);
  chunk.records.push_back(reward);
  chunk.records.push_back(terminated ? 1.0f : 0.0f);
  ++chunk.counts.rows;
  chunk.counts.terminated_rows += terminated ? 1 : 0;
  chunk.counts.reward_sum += reward;
  return !terminated;
}

Result<RolloutCounts> ModelRollout::Finish(ReplayBuffer& pool) {
  if (!done()) worker_.join();
  B4MRL_RETURN_IF_ERROR(std::exchange(worker_status_, Status()));
  // Chunks finish out of order, since a chunk whose rollouts all end early overtakes others.
  std::sort(finished_.begin(), finished_.end(),
            [](const auto& a, const auto& b) { return a->first_row < b->first_row; });
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
    counts.terminated_rows += chunk->counts.terminated_rows;
    counts.reward_sum += chunk->counts.reward_sum;
  }
  finished_.clear();
  return counts;
}

}  // namespace b4mrl

#include "algorithms/experience/training_dataset.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "algorithms/policy/observation_mask.h"
#include "client/client.h"

namespace b4mrl {

namespace {

// A number of the dataset that is not finite: kDataLoss, which names dataset, place and number.
Status NotFinite(const RemoteDataset& dataset, const std::string& what, double value) {
  return Status(StatusCode::kDataLoss, fmt::format("dataset {}: {} is {}, allowed: finite numbers",
                                                   dataset.in_force().info().name(), what, value));
}

// What can be known without reading all rows.
Status CheckFinite(RemoteDataset& dataset) {
  if (dataset.rows() == 0) return Status();  // statistics of no rows are NaN
  B4MRL_ASSIGN_OR_RETURN(const DatasetStats stats, dataset.Stats());
  for (size_t i = 0; i < stats.observation_mean.size(); ++i) {
    if (!std::isfinite(stats.observation_mean[i])) {
      return NotFinite(dataset, fmt::format("the mean of observation dimension {}", i),
                       stats.observation_mean[i]);
    }
    if (!std::isfinite(stats.observation_std[i])) {
      return NotFinite(dataset, fmt::format("the std of observation dimension {}", i),
                       stats.observation_std[i]);
    }
  }
  for (const double reward : {stats.scores.min_reward(), stats.scores.max_reward()}) {
    if (!std::isfinite(reward)) return NotFinite(dataset, "a reward", reward);
  }
  return Status();
}

// Without an early end, so that the compiler makes vector instructions of it.
bool AllFiniteFast(std::span<const float> values) {
  constexpr float kMax = std::numeric_limits<float>::max();
  int others = 0;
  for (const float value : values) others += std::abs(value) <= kMax ? 0 : 1;
  return others == 0;
}

}  // namespace

Result<std::unique_ptr<RemoteDataset>> OpenTrainingDataset(const LearnerContext& context) {
  DatasetOptions options;
  options.corruption = context.corruption;
  options.deadline_ms = kLearnerDeadlineMs;
  options.ledger = context.ledger;
  options.seed = context.corruption_seed;
  options.transition_rule = context.transitions;
  options.environment = context.environment.name;
  B4MRL_ASSIGN_OR_RETURN(RemoteDataset opened,
                         context.client->OpenDataset(context.dataset, options));
  auto dataset = std::make_unique<RemoteDataset>(std::move(opened));
  // The daemon has compared the names of the environments. The networks have these sizes.
  B4MRL_RETURN_IF_ERROR(context.environment.CheckSizes(fmt::format("dataset {}", context.dataset),
                                                       dataset->observation_size(),
                                                       dataset->action_size()));
  B4MRL_RETURN_IF_ERROR(CheckFinite(*dataset));
  return dataset;
}

Status CheckFiniteRows(const RemoteDataset& dataset, const TransitionRows& rows,
                       uint64_t first_row) {
  struct Column {
    std::string_view name;
    std::span<const float> values;
  };
  for (const auto& [name, values] :
       {Column{"observation", rows.observations}, Column{"action", rows.actions},
        Column{"reward", rows.rewards}, Column{"next observation", rows.next_observations}}) {
    if (AllFiniteFast(values)) continue;
    const auto found = std::ranges::find_if_not(values, [](float x) { return std::isfinite(x); });
    const size_t place = found - values.begin(), width = values.size() / rows.rows;
    const size_t row = place / width;
    return NotFinite(dataset,
                     fmt::format("dimension {} of the {} in row {}", place % width, name,
                                 rows.indices.empty() ? first_row + row : rows.indices[row]),
                     *found);
  }
  return Status();
}

int RealRows(const Hyperparameters& values) {
  // 0.29 of 100 rows are 29, although the product of the two doubles is a little less.
  return static_cast<int>(values.Number("real-ratio") * values.Number("batch-size") + 1e-9);
}

Status CheckRowsPerUpdate(const LearnerContext& context, std::string_view name, uint64_t rows) {
  const uint32_t most = RemoteDataset::MaxRowsPerRequest(context.environment.observation.size(),
                                                         context.environment.action.size());
  if (rows <= most) return Status();
  return InvalidNumber(name, static_cast<double>(rows),
                       fmt::format("1..{}, the rows that one request for a dataset of {} holds",
                                   most, context.environment.name));
}

Result<std::vector<float>> DrawStarts(RemoteDataset& dataset, uint32_t rows, uint64_t seed,
                                      uint64_t cycle) {
  const uint32_t most = dataset.max_rows_per_request();
  const uint64_t requests = (uint64_t{rows} + most - 1) / most;
  std::vector<float> starts;
  starts.reserve(rows * dataset.observation_size());
  for (uint64_t i = 0; i < requests; ++i) {
    const auto left = static_cast<uint32_t>(rows - i * most);
    B4MRL_ASSIGN_OR_RETURN(const TransitionRows batch,
                           dataset.Sample(std::min(left, most), seed, cycle * requests + i));
    starts.insert(starts.end(), batch.observations.begin(), batch.observations.end());
  }
  return starts;
}

Result<TrainingDataset> TrainingDataset::Open(const LearnerContext& context, int rows) {
  B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<RemoteDataset> remote, OpenTrainingDataset(context));
  B4MRL_ASSIGN_OR_RETURN(
      std::vector<float> mask,
      MaskOfDimensions(remote->observation_size(), remote->in_force().hidden_dimensions()));
  return TrainingDataset(std::move(remote), rows, RoleSeed(context.seed, "batches"),
                         std::move(mask));
}

TrainingDataset::TrainingDataset(std::unique_ptr<RemoteDataset> remote, int rows, uint64_t seed,
                                 std::vector<float> mask)
    : remote_(std::move(remote)), rows_(rows), seed_(seed), mask_(std::move(mask)) {}

void TrainingDataset::Start(uint64_t update) {
  if (rows_ > 0) stream_.emplace(remote_->Stream(static_cast<uint32_t>(rows_), seed_, update));
}

Result<TransitionRows> TrainingDataset::Next() {
  if (rows_ == 0) return TransitionRows();
  B4MRL_ASSIGN_OR_RETURN(TransitionRows rows, stream_->Next());
  // The opening has looked at the observations.
  if (AllFiniteFast(rows.actions) && AllFiniteFast(rows.rewards) &&
      AllFiniteFast(rows.next_observations)) {
    return rows;
  }
  // Batches come without their rows' numbers: ask for the same batch again, with them.
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows again,
                         remote_->Sample(static_cast<uint32_t>(rows_), seed_, rows.first_batch, 1,
                                         /*with_indices=*/true));
  B4MRL_RETURN_IF_ERROR(CheckFiniteRows(*remote_, again));
  return rows;
}

Status TrainingDataset::Load(CheckpointReader& reader, uint64_t update) {
  const std::string saved = reader.Text("dataset");
  B4MRL_RETURN_IF_ERROR(reader.status());
  if (saved != remote_->fingerprint()) {
    return Status(
        StatusCode::kDataLoss,
        fmt::format("the run's dataset has fingerprint {}, now it is {}: its rows changed, or an "
                    "earlier version of b4mrl began the run; without its folder it begins anew",
                    saved, remote_->fingerprint()));
  }
  Start(update);
  return Status();
}

}  // namespace b4mrl

// DynamicsEnsemble's training: splitting, minibatches, hold-out evaluation, early stopping.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/nn/gaussian_head.h"
#include "algorithms/nn/products/eigen_map.h"

namespace b4mrl {
namespace {

void Shuffle(Rng rng, std::span<int32_t> values) {
  for (size_t i = values.size(); i > 1; --i) std::swap(values[i - 1], values[rng.Below(i)]);
}

Status ValidateBlock(const std::string& name, int rows, int columns, int expected_rows,
                     int expected_columns) {
  if (rows != expected_rows) {
    return InvalidArgument(name + " features", std::to_string(rows), std::to_string(expected_rows));
  }
  if (columns != expected_columns) {
    return InvalidArgument(name + " rows", std::to_string(columns),
                           std::to_string(expected_columns));
  }
  return {};
}

// Member m's rows of `block`, or the whole block if the members share its rows.
template <typename Scalar>
MatrixView<const Scalar> MemberRows(int m, int rows, MatrixView<const Scalar> block) {
  return block.rows == rows ? block : block.RowBlock(m * rows, rows);
}

}  // namespace

template <typename Scalar>
Status DynamicsEnsemble<Scalar>::ValidateData(const DynamicsData<Scalar>& data) const {
  const int rows = data.observations.columns;
  if (rows < 2) {
    return InvalidArgument("number of transitions", std::to_string(rows), "at least 2");
  }
  B4MRL_RETURN_IF_ERROR(
      ValidateBlock("observation", data.observations.rows, rows, options_.observation_size, rows));
  B4MRL_RETURN_IF_ERROR(
      ValidateBlock("action", data.actions.rows, data.actions.columns, options_.action_size, rows));
  return ValidateBlock("target", data.targets.rows, data.targets.columns, output_size(), rows);
}

template <typename Scalar>
Status DynamicsEnsemble<Scalar>::StartTraining(const DynamicsData<Scalar>& data) {
  B4MRL_RETURN_IF_ERROR(ValidateData(data));
  SplitRows(data.observations.columns);
  if (options_.scale_inputs) FitScaler(data);
  order_.resize(train_rows_.size());
  order_epoch_ = -1;
  return {};
}

template <typename Scalar>
int64_t DynamicsEnsemble<Scalar>::UpdatesPerEpoch() const {
  const int64_t rows = static_cast<int64_t>(train_rows_.size());
  return (rows + options_.batch_size - 1) / options_.batch_size;
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::SplitRows(int rows) {
  std::vector<int32_t> all(rows);
  std::iota(all.begin(), all.end(), 0);
  if (options_.holdout_rule == HoldoutRule::kPermutation) {
    Shuffle(Rng(options_.seed, "ensemble-holdout"), all);
  }
  const int64_t wanted =
      std::min(static_cast<int64_t>(rows * options_.holdout_fraction), options_.holdout_max);
  const int64_t held_out = std::clamp<int64_t>(wanted, 1, rows - 1);
  train_rows_.assign(all.begin(), all.end() - held_out);
  holdout_rows_.assign(all.end() - held_out, all.end());
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::FitScaler(const DynamicsData<Scalar>& data) {
  const int size = layout_.shape().inputs;
  std::vector<double> sum(size), square(size);
  const auto value = [&](int32_t row, int k) -> double {
    const int split = options_.observation_size;
    return k < split ? data.observations(k, row) : data.actions(k - split, row);
  };
  const double count = static_cast<double>(train_rows_.size());
  for (const int32_t row : train_rows_) {
    for (int k = 0; k < size; ++k) sum[k] += value(row, k);
  }
  for (const int32_t row : train_rows_) {
    for (int k = 0; k < size; ++k) square[k] += std::pow(value(row, k) - sum[k] / count, 2);
  }
  for (int k = 0; k < size; ++k) {
    const double deviation = std::sqrt(square[k] / count);
    scaler_[k] = static_cast<Scalar>(sum[k] / count);
    // A constant input, such as a hidden dimension, is only centred.
    scaler_[size + k] = static_cast<Scalar>(deviation < 1e-12 ? 1.0 : 1 / deviation);
  }
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::ShuffleEpoch() {
  if (order_epoch_ == epoch_) return;
  order_epoch_ = epoch_;
  std::iota(order_.begin(), order_.end(), 0);
  Shuffle(Rng(options_.seed, "ensemble-order", static_cast<uint64_t>(epoch_)), order_);
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::GatherRow(const DynamicsData<Scalar>& data, int row, int block,
                                         int column) {
  const int inputs = layout_.shape().inputs;
  Scalar* input = inputs_.view().column(column) + block * inputs;
  std::copy_n(data.observations.column(row), options_.observation_size, input);
  std::copy_n(data.actions.column(row), options_.action_size, input + options_.observation_size);
  std::copy_n(data.targets.column(row), output_size(),
              targets_.view().column(column) + block * output_size());
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::GatherBatch(const DynamicsData<Scalar>& data, int64_t first,
                                           int count) {
  const int inputs = layout_.shape().inputs;
  const int blocks = options_.bootstrap ? options_.members : 1;
  for (int block = 0; block < blocks; ++block) {
    // A member's bootstrap sample is not stored: its entry i is drawn from position i of the
    // stream.
    Rng bootstrap(options_.seed, "ensemble-bootstrap", static_cast<uint64_t>(block));
    for (int column = 0; column < count; ++column) {
      int64_t position = order_[first + column];
      if (options_.bootstrap) {
        bootstrap.Seek(static_cast<uint64_t>(position));
        position = static_cast<int64_t>(bootstrap.Below(train_rows_.size()));
      }
      GatherRow(data, train_rows_[position], block, column);
    }
    Scale(inputs_.view(count).RowBlock(block * inputs, inputs));
  }
}

// Each member goes through forward pass, loss, backward pass and optimiser in one piece, so that
// its numbers are still in the cache at each of these.
template <typename Scalar>
double DynamicsEnsemble<Scalar>::UpdateOnBatch(MatrixView<const Scalar> inputs,
                                               MatrixView<const Scalar> targets) {
  const int size = output_size();
  const Scalar bound_weight = static_cast<Scalar>(options_.bound_weight);
  EigenColumn<Scalar> bounds(bounds_.values.data(), 2 * size);
  EigenColumn<Scalar> bounds_gradient(bounds_.gradient.data(), 2 * size);
  bounds_gradient.head(size).setConstant(bound_weight);
  bounds_gradient.tail(size).setConstant(-bound_weight);
  double loss = options_.bound_weight *
                static_cast<double>(bounds.head(size).sum() - bounds.tail(size).sum());
  weights_.adam.BeginStep();
  team_->ForEach(options_.members, [&](int m, int thread) {
    member_loss_[m] = UpdateMember(m, MemberRows(m, layout_.shape().inputs, inputs),
                                   MemberRows(m, size, targets), workspaces_[thread]);
  });
  for (int m = 0; m < options_.members; ++m) {  // in member order, for equal bits
    loss += member_loss_[m];
    bounds_gradient += ConstEigenColumn<Scalar>(member_bounds_gradient_.view().column(m), 2 * size);
  }
  bounds_.Step();
  return loss;
}

template <typename Scalar>
double DynamicsEnsemble<Scalar>::UpdateMember(int m, MatrixView<const Scalar> inputs,
                                              MatrixView<const Scalar> targets,
                                              MlpWorkspace<Scalar>& workspace) {
  const MatrixView<Scalar> output =
      MlpForward<Scalar>(layout_, weights_.values, inputs, workspace, m);
  const std::span<Scalar> bounds_gradient(member_bounds_gradient_.view().column(m),
                                          bounds_.values.size());
  std::ranges::fill(bounds_gradient, Scalar(0));
  const double loss = GaussianHeadLoss<Scalar>(output, targets, bounds_.values,
                                               workspace.output_gradient(), bounds_gradient);
  MlpBackward<Scalar>(layout_, weights_.values, inputs, workspace, weights_.gradient, m);
  layout_.ForEachRange(m, [this](int64_t first, int64_t count) {
    weights_.adam.StepPart(weights_.values, weights_.gradient, first, count);
  });
  return loss;
}

template <typename Scalar>
bool DynamicsEnsemble<Scalar>::CanGoOn() const {
  if (epoch_ < 0 || updates_ < 0 || updates_in_epoch_ < 0) return false;
  if (finished_ != 0) return finished_ == 1;
  return train_rows_.empty() || updates_in_epoch_ < UpdatesPerEpoch();
}

template <typename Scalar>
DynamicsProgress DynamicsEnsemble<Scalar>::Train(const DynamicsData<Scalar>& data,
                                                 int64_t max_updates) {
  const int64_t rows = static_cast<int64_t>(train_rows_.size());
  const int64_t per_epoch = UpdatesPerEpoch();
  bool epoch_ended = false;
  for (int64_t i = 0; i < max_updates && finished_ == 0 && !epoch_ended; ++i) {
    ShuffleEpoch();
    const int64_t first = updates_in_epoch_ * options_.batch_size;
    const int count = static_cast<int>(std::min<int64_t>(options_.batch_size, rows - first));
    GatherBatch(data, first, count);
    train_loss_ = UpdateOnBatch(inputs_.view(count), targets_.view(count));
    ++updates_;
    ++updates_in_epoch_;
    epoch_ended = updates_in_epoch_ == per_epoch || updates_ >= options_.max_updates;
  }
  if (epoch_ended) EndEpoch(data);
  return {.epoch = epoch_,
          .updates = updates_,
          .train_loss = train_loss_,
          .epoch_ended = epoch_ended,
          .finished = finished_ != 0,
          .holdout_mse = holdout_mse_};
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::EndEpoch(const DynamicsData<Scalar>& data) {
  ++epoch_;
  updates_in_epoch_ = 0;
  EvaluateHoldout(data);
  epochs_without_improvement_ = KeepImproved() ? 0 : epochs_without_improvement_ + 1;
  if (epochs_without_improvement_ >= options_.patience_epochs || updates_ >= options_.max_updates) {
    FinishTraining();
  }
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::EvaluateHoldout(const DynamicsData<Scalar>& data) {
  const int size = output_size();
  const int inputs = layout_.shape().inputs;
  std::fill(holdout_mse_.begin(), holdout_mse_.end(), 0.0);
  const int rows = static_cast<int>(holdout_rows_.size());
  for (int first = 0; first < rows; first += options_.batch_size) {
    const int count = std::min(options_.batch_size, rows - first);
    for (int i = 0; i < count; ++i) GatherRow(data, holdout_rows_[first + i], 0, i);
    const MatrixView<Scalar> block = inputs_.view(count).RowBlock(0, inputs);
    Scale(block);
    const MatrixView<Scalar> targets = targets_.view(count).RowBlock(0, size);
    team_->ForEach(options_.members, [&](int m, int thread) {
      const MatrixView<Scalar> mean =
          MlpForward<Scalar>(layout_, weights_.values, block, workspaces_[thread], m)
              .RowBlock(0, size);
      holdout_mse_[m] += static_cast<double>((ToEigen(mean) - ToEigen(targets)).squaredNorm());
    });
  }
  for (double& mse : holdout_mse_) mse /= static_cast<double>(rows) * size;
}

template <typename Scalar>
bool DynamicsEnsemble<Scalar>::KeepImproved() {
  bool improved = false;
  for (int m = 0; m < options_.members; ++m) {
    const Scalar mse = static_cast<Scalar>(holdout_mse_[m]);
    const bool first = std::isinf(best_mse_[m]) && std::isfinite(mse);
    if (!first && !((best_mse_[m] - mse) / best_mse_[m] > options_.min_improvement)) continue;
    improved = true;
    best_mse_[m] = mse;
    layout_.ForEachRange(m, [this](int64_t range, int64_t count) {
      std::copy_n(weights_.values.begin() + range, count, best_weights_.begin() + range);
    });
  }
  return improved;
}

template <typename Scalar>
bool DynamicsEnsemble<Scalar>::HasKeptWeights() const {
  return std::ranges::any_of(best_mse_, [](Scalar mse) { return std::isfinite(mse); });
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::FinishTraining() {
  finished_ = 1;
  // Before the end of the first epoch no weights are known to be better than the present ones.
  if (epoch_ > 0) weights_.values = best_weights_;
}

#define B4MRL_INSTANTIATE(Scalar)                                                                  \
  template Status DynamicsEnsemble<Scalar>::StartTraining(const DynamicsData<Scalar>&);            \
  template bool DynamicsEnsemble<Scalar>::CanGoOn() const;                                         \
  template DynamicsProgress DynamicsEnsemble<Scalar>::Train(const DynamicsData<Scalar>&, int64_t); \
  template bool DynamicsEnsemble<Scalar>::HasKeptWeights() const;                                  \
  template void DynamicsEnsemble<Scalar>::FinishTraining();                                        \
  template double DynamicsEnsemble<Scalar>::UpdateOnBatch(MatrixView<const Scalar>,                \
                                                          MatrixView<const Scalar>);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl

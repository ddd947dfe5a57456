#include "algorithms/model/dynamics_ensemble.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/nn/gaussian_head.h"
#include "algorithms/nn/products/eigen_map.h"

namespace b4mrl {
namespace {

// Columns of one prediction pass: enough for full speed, few enough to stay in the cache.
constexpr int kPredictionBlock = 512;

Status Validate(const DynamicsEnsembleOptions& options) {
  B4MRL_RETURN_IF_ERROR(ValidateSizes(options.observation_size, options.action_size, options.hidden,
                                      options.batch_size));
  B4MRL_RETURN_IF_ERROR(CheckPrecision(options.precision));
  if (options.observation_size >= kGaussianOutputsMax) {
    return InvalidNumber("observation_size", options.observation_size,
                         "below " + std::to_string(kGaussianOutputsMax));
  }
  if (options.members < 1 || options.members > 64) {
    return InvalidNumber("members", options.members, "1..64");
  }
  if (options.elites < 1 || options.elites > options.members) {
    return InvalidNumber("elites", options.elites, "1..members");
  }
  if (options.decay.size() != options.hidden.size() + 1) {
    return InvalidNumber("length of decay", static_cast<double>(options.decay.size()),
                         std::to_string(options.hidden.size() + 1) + ", one per layer");
  }
  for (const double decay : options.decay) B4MRL_RETURN_IF_ERROR(ValidateRate("decay", decay));
  B4MRL_RETURN_IF_ERROR(ValidateRate("decay_scale", options.decay_scale));
  B4MRL_RETURN_IF_ERROR(ValidateRate("learning_rate", options.learning_rate));
  B4MRL_RETURN_IF_ERROR(ValidateRate("bound_weight", options.bound_weight));
  B4MRL_RETURN_IF_ERROR(ValidateUnitInterval("min_improvement", options.min_improvement));
  if (!(options.holdout_fraction > 0 && options.holdout_fraction < 1)) {
    return InvalidNumber("holdout_fraction", options.holdout_fraction, "between 0 and 1");
  }
  if (!(options.min_log_var < options.max_log_var)) {
    return InvalidNumber("min_log_var", options.min_log_var, "below max_log_var");
  }
  if (options.holdout_max < 1) {
    return InvalidNumber("holdout_max", static_cast<double>(options.holdout_max), "at least 1");
  }
  if (options.patience_epochs < 1) {
    return InvalidNumber("patience_epochs", options.patience_epochs, "at least 1");
  }
  if (options.max_updates < 1) {
    return InvalidNumber("max_updates", static_cast<double>(options.max_updates), "at least 1");
  }
  return {};
}

std::vector<DecayRange> DecayRanges(const DynamicsEnsembleOptions& options,
                                    const MlpLayout& layout) {
  std::vector<DecayRange> ranges;
  for (size_t i = 0; i < layout.layers().size(); ++i) {
    const MlpLayout::Layer& layer = layout.layers()[i];
    ranges.push_back({layer.weight, layer.weight_size, 2 * options.decay_scale * options.decay[i]});
  }
  return ranges;
}

}  // namespace

MlpLayout LayoutOf(const DynamicsEnsembleOptions& options) {
  return MlpLayout({.members = options.members,
                    .inputs = options.observation_size + options.action_size,
                    .hidden = options.hidden,
                    .outputs = 2 * (options.observation_size + 1),
                    .activation = Activation::kSwish});
}

template <typename Scalar>
Result<DynamicsEnsemble<Scalar>> DynamicsEnsemble<Scalar>::Create(
    const DynamicsEnsembleOptions& options, int threads) {
  B4MRL_RETURN_IF_ERROR(Validate(options));
  if (threads < 1) return InvalidNumber("threads", threads, "at least 1");
  return DynamicsEnsemble(options, std::min(threads, options.members));
}

template <typename Scalar>
DynamicsEnsemble<Scalar>::DynamicsEnsemble(const DynamicsEnsembleOptions& options, int threads)
    : options_(options),
      layout_(LayoutOf(options)),
      weights_(layout_.size(), options.learning_rate, DecayRanges(options, layout_)),
      bounds_(2 * output_size(), options.learning_rate),
      scaler_(2 * static_cast<size_t>(layout_.shape().inputs)),
      best_mse_(options.members, std::numeric_limits<Scalar>::infinity()),
      holdout_mse_(options.members, std::numeric_limits<double>::quiet_NaN()),
      team_(std::make_shared<ThreadTeam>(threads)),
      workspaces_(threads, MlpWorkspace<Scalar>(layout_, {.batch_max = options.batch_size,
                                                          .precision = options.precision})),
      scratch_(threads, {MlpWorkspace<Scalar>(layout_, {.batch_max = kPredictionBlock,
                                                        .keep_gradients = false,
                                                        .precision = options.precision}),
                         MatrixBuffer<Scalar>(layout_.shape().inputs, kPredictionBlock),
                         MatrixBuffer<Scalar>(output_size(), kPredictionBlock),
                         {}}),
      inputs_((options.bootstrap ? options.members : 1) * layout_.shape().inputs,
              options.batch_size),
      targets_((options.bootstrap ? options.members : 1) * output_size(), options.batch_size),
      member_bounds_gradient_(2 * output_size(), options.members),
      member_loss_(options.members) {
  Rng rng(options.seed, "ensemble-weights");
  layout_.Initialize<Scalar>(options.initialization, rng, weights_.values);
  best_weights_ = weights_.values;
  std::fill_n(bounds_.values.begin(), output_size(), static_cast<Scalar>(options.max_log_var));
  std::fill_n(bounds_.values.begin() + output_size(), output_size(),
              static_cast<Scalar>(options.min_log_var));
  std::fill_n(scaler_.begin() + layout_.shape().inputs, layout_.shape().inputs, Scalar(1));
  for (Scratch& scratch : scratch_) scratch.columns.reserve(kPredictionBlock);
}

template <typename Scalar>
double DynamicsEnsemble<Scalar>::DecayLoss() const {
  double loss = 0;
  for (const DecayRange& range : DecayRanges(options_, layout_)) {
    const ConstEigenColumn<Scalar> weights(weights_.values.data() + range.first, range.size);
    loss += 0.5 * range.coefficient * static_cast<double>(weights.square().sum());
  }
  return loss;
}

template <typename Scalar>
std::vector<int> DynamicsEnsemble<Scalar>::Elites() const {
  std::vector<int> members(options_.members);
  std::iota(members.begin(), members.end(), 0);
  std::stable_sort(members.begin(), members.end(),
                   [this](int a, int b) { return best_mse_[a] < best_mse_[b]; });
  members.resize(options_.elites);
  return members;
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::Scale(MatrixView<Scalar> inputs) const {
  if (!options_.scale_inputs) return;
  const int size = layout_.shape().inputs;
  for (int column = 0; column < inputs.columns; ++column) {
    Scalar* values = inputs.column(column);
    for (int k = 0; k < size; ++k) values[k] = (values[k] - scaler_[k]) * scaler_[size + k];
  }
}

template <typename Scalar>
MatrixView<Scalar> DynamicsEnsemble<Scalar>::ScaledCopy(MatrixView<const Scalar> inputs,
                                                        Scratch& scratch) const {
  const MatrixView<Scalar> block = scratch.inputs.view(inputs.columns);
  CopyMatrix<Scalar>(inputs, block);
  Scale(block);
  return block;
}

// Draws samples from `head`, whose column i holds a member's means and bounded log-variances for
// column scratch.columns[i] of a batch.
template <typename Scalar>
void DynamicsEnsemble<Scalar>::SampleHead(MatrixView<Scalar> head, MatrixView<const Scalar> noise,
                                          MatrixView<Scalar> outputs, Scratch& scratch) const {
  const std::vector<int>& columns = scratch.columns;
  const int count = static_cast<int>(columns.size());
  const int size = output_size();
  const MatrixView<Scalar> block_noise = scratch.noise.view(count);
  for (int i = 0; i < count; ++i) {
    std::copy_n(noise.column(columns[i]), size, block_noise.column(i));
  }
  SampleGaussian<Scalar>(head.RowBlock(0, size), head.RowBlock(size, size), block_noise,
                         head.RowBlock(0, size));
  for (int i = 0; i < count; ++i) std::copy_n(head.column(i), size, outputs.column(columns[i]));
}

// Draws samples from `member` for the columns listed in scratch.columns.
template <typename Scalar>
void DynamicsEnsemble<Scalar>::SampleGroup(int member, MatrixView<const Scalar> inputs,
                                           MatrixView<const Scalar> noise,
                                           MatrixView<Scalar> outputs, Scratch& scratch) const {
  const int count = static_cast<int>(scratch.columns.size());
  const MatrixView<Scalar> block = scratch.inputs.view(count);
  for (int i = 0; i < count; ++i) {
    std::copy_n(inputs.column(scratch.columns[i]), inputs.rows, block.column(i));
  }
  Scale(block);
  const MatrixView<Scalar> head =
      MlpForward<Scalar>(layout_, weights_.values, block, scratch.workspace, member);
  BoundLogVariances<Scalar>(bounds_.values, head.RowBlock(output_size(), output_size()));
  SampleHead(head, noise, outputs, scratch);
}

// Draws samples for all columns that drew `member`.
template <typename Scalar>
void DynamicsEnsemble<Scalar>::SampleDrawn(int member, MatrixView<const Scalar> inputs,
                                           std::span<const int> members,
                                           MatrixView<const Scalar> noise,
                                           MatrixView<Scalar> outputs, Scratch& scratch) const {
  std::vector<int>& columns = scratch.columns;
  columns.clear();
  for (int i = 0; i < inputs.columns; ++i) {
    if (members[i] == member) columns.push_back(i);
    const bool last = i + 1 == inputs.columns;
    if (columns.empty()) continue;
    if (last || static_cast<int>(columns.size()) == kPredictionBlock) {
      SampleGroup(member, inputs, noise, outputs, scratch);
      columns.clear();
    }
  }
}

// Computes samples and penalties of one block of columns: every member predicts the whole block for
// the penalty; each column's sample comes from the member that it drew.
template <typename Scalar>
void DynamicsEnsemble<Scalar>::SamplePenalised(MatrixView<const Scalar> inputs,
                                               std::span<const int> members,
                                               MatrixView<const Scalar> noise,
                                               MatrixView<Scalar> outputs,
                                               std::span<Scalar> penalty, Scratch& scratch) const {
  const int size = output_size();
  const MatrixView<Scalar> scaled = ScaledCopy(inputs, scratch);
  std::vector<int>& columns = scratch.columns;
  for (int m = 0; m < options_.members; ++m) {
    const MatrixView<Scalar> head =
        MlpForward<Scalar>(layout_, weights_.values, scaled, scratch.workspace, m);
    const MatrixView<Scalar> log_var = head.RowBlock(size, size);
    BoundLogVariances<Scalar>(bounds_.values, log_var);
    columns.clear();
    for (int i = 0; i < inputs.columns; ++i) {
      const ConstEigenColumn<Scalar> column(log_var.column(i), size);
      // The squared L2 norm of the standard deviations is the sum of the variances.
      const Scalar norm = std::sqrt(column.exp().sum());
      // A NaN of any member stays, so that the row is dropped.
      if (!(norm <= penalty[i]) && !std::isnan(penalty[i])) penalty[i] = norm;
      if (members[i] != m) continue;
      std::copy_n(head.column(i), head.rows, head.column(static_cast<int>(columns.size())));
      columns.push_back(i);
    }
    SampleHead(head.ColumnBlock(0, static_cast<int>(columns.size())), noise, outputs, scratch);
  }
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::Sample(MatrixView<const Scalar> inputs, std::span<const int> members,
                                      MatrixView<const Scalar> noise, MatrixView<Scalar> outputs,
                                      std::span<Scalar> penalty) {
  if (penalty.empty()) {
    team_->ForEach(options_.members, [&](int m, int thread) {
      SampleDrawn(m, inputs, members, noise, outputs, scratch_[thread]);
    });
    return;
  }
  std::fill(penalty.begin(), penalty.end(), Scalar(0));
  const int blocks = (inputs.columns + kPredictionBlock - 1) / kPredictionBlock;
  team_->ForEach(blocks, [&](int block, int thread) {
    const int first = block * kPredictionBlock;
    const int count = std::min(kPredictionBlock, inputs.columns - first);
    SamplePenalised(inputs.ColumnBlock(first, count), members.subspan(first, count),
                    noise.ColumnBlock(first, count), outputs.ColumnBlock(first, count),
                    penalty.subspan(first, count), scratch_[thread]);
  });
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::Predict(int member, MatrixView<const Scalar> inputs,
                                       MatrixView<Scalar> mean, MatrixView<Scalar> log_var) {
  const int size = output_size();
  Scratch& scratch = scratch_[0];
  for (int first = 0; first < inputs.columns; first += kPredictionBlock) {
    const int count = std::min(kPredictionBlock, inputs.columns - first);
    const MatrixView<Scalar> head = MlpForward<Scalar>(
        layout_, weights_.values, ScaledCopy(inputs.ColumnBlock(first, count), scratch),
        scratch.workspace, member);
    BoundLogVariances<Scalar>(bounds_.values, head.RowBlock(size, size));
    CopyMatrix<Scalar>(head.RowBlock(0, size), mean.ColumnBlock(first, count));
    CopyMatrix<Scalar>(head.RowBlock(size, size), log_var.ColumnBlock(first, count));
  }
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::VisitArrays(const ArrayVisitor<Scalar>& visitor) {
  const int size = output_size();
  layout_.Visit<Scalar>("ensemble", weights_.values, visitor);
  layout_.Visit<Scalar>("best_ensemble", best_weights_, visitor);
  visitor({"max_log_var", {size}, std::span<Scalar>(bounds_.values).first(size)});
  visitor({"min_log_var", {size}, std::span<Scalar>(bounds_.values).last(size)});
  visitor({"input_scaler", {2, layout_.shape().inputs}, scaler_});
  visitor({"best_holdout_mse", {options_.members}, best_mse_});
  weights_.adam.Visit("ensemble/adam", visitor);
  bounds_.adam.Visit("bounds/adam", visitor);
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::VisitCounters(const CounterVisitor& visitor) {
  visitor({"epoch", &epoch_});
  visitor({"updates", &updates_});
  visitor({"updates_in_epoch", &updates_in_epoch_});
  visitor({"epochs_without_improvement", &epochs_without_improvement_});
  visitor({"finished", &finished_});
  weights_.VisitCounters("ensemble", visitor);
  bounds_.VisitCounters("bounds", visitor);
}

template <typename Scalar>
void DynamicsEnsemble<Scalar>::VisitGradients(const ArrayVisitor<Scalar>& visitor) {
  const int size = output_size();
  layout_.Visit<Scalar>("ensemble", weights_.gradient, visitor);
  visitor({"max_log_var", {size}, std::span<Scalar>(bounds_.gradient).first(size)});
  visitor({"min_log_var", {size}, std::span<Scalar>(bounds_.gradient).last(size)});
}

template class DynamicsEnsemble<float>;
template class DynamicsEnsemble<double>;

}  // namespace b4mrl

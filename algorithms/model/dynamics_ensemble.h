// An ensemble of probabilistic networks (o, a) -> N(mean, diag(exp(log_var))), as MOPO trains it.
//
// Yu et al., "MOPO" (2020); defaults are those of the implementation B4MRL used
// (junming-yang/mopo): no input scaling, no bootstrap, the data's last tenth held out. The caller
// gives each row's target, observation part first, reward last: MOPO passes [o' - o, r], HyMOPO
// [o' - o'_sim, r]. Loss of one minibatch (B columns, K = observation_size + 1 outputs):
//   sum over members of mean_{B,K}((mean - target)^2 exp(-lv)) + mean_{B,K}(lv)
//   + decay_scale * sum over layers of decay[layer] * sum(weight^2)
//   + bound_weight * (sum(max_log_var) - sum(min_log_var))
//   with lv = max - softplus(max - raw), then lv = min + softplus(lv - min),
// max and min being trained vectors of length K that all members share. After each epoch a member's
// weights are kept if its hold-out squared error fell by more than min_improvement (relative).
// Training ends after patience_epochs epochs in a row in which no member improved, or after
// max_updates updates. The kept weights are then restored; elites are the members of smallest
// hold-out error.
//
// The optimiser adds the decay term's gradient, so VisitGradients does not show it.
// dynamics_training.cc holds the training (StartTraining to UpdateOnBatch), dynamics_ensemble.cc
// construction, prediction and visitors; ensemble_store.h keeps trained ensembles on disk.
//
// Training: StartTraining, then Train until progress.finished (or FinishTraining at any time).
// Visit* show the complete state between two calls of Train, so training may be resumed there; all
// calls must be given equal data. Thread rule: one thread at a time; the ensemble's own threads
// share out the members, and their number changes no bit.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "algorithms/nn/network.h"
#include "proto/base/status.h"

namespace b4mrl {

enum class HoldoutRule {
  kTail,         // the last rows in file order
  kPermutation,  // rows of a random permutation (MOPO's original)
};

struct DynamicsEnsembleOptions {
  int observation_size = 0;
  int action_size = 0;
  int members = 7;
  int elites = 5;
  std::vector<int> hidden = {200, 200, 200, 200};
  Initialization initialization = Initialization::kTorchUniform;
  double learning_rate = 1e-3;
  int batch_size = 256;
  std::vector<double> decay = {2.5e-5, 5e-5, 7.5e-5, 7.5e-5, 1e-4};  // per layer, weights only
  double decay_scale = 1.0;                                          // 0.5 in MOPO's original
  double bound_weight = 0.01;
  double max_log_var = 0.5;   // initial upper bound of log-variances
  double min_log_var = -10;   // initial lower bound of log-variances
  bool bootstrap = false;     // each member draws its own rows with replacement
  bool scale_inputs = false;  // standardise inputs by the training rows' mean and deviation
  HoldoutRule holdout_rule = HoldoutRule::kTail;
  double holdout_fraction = 0.1;
  int64_t holdout_max = INT64_MAX;  // 1000 in MOPO's original
  double min_improvement = 0.01;
  int patience_epochs = 5;
  int64_t max_updates = 800000;
  uint64_t seed = 0;
  Precision precision = Precision::kFp32;  // of products between two hidden layers
};

// Columns are rows of the data set: (observation | action | observation + 1) x N, owned by the
// caller.
template <typename Scalar>
struct DynamicsData {
  MatrixView<const Scalar> observations;
  MatrixView<const Scalar> actions;
  MatrixView<const Scalar> targets;
};

struct DynamicsProgress {
  int64_t epoch = 0;         // epochs completed
  int64_t updates = 0;       // updates in all epochs
  double train_loss = 0;     // of the last minibatch, without the weights' decay
  bool epoch_ended = false;  // whether this call ended an epoch and updated holdout_mse
  bool finished = false;
  std::vector<double> holdout_mse;  // hold-out squared error per member after the last epoch
};

// The layout of all members' networks.
MlpLayout LayoutOf(const DynamicsEnsembleOptions& options);

template <typename Scalar>
class DynamicsEnsemble {
 public:
  // Uses at most `options.members` threads. Copies of an ensemble share its threads.
  static Result<DynamicsEnsemble> Create(const DynamicsEnsembleOptions& options, int threads = 1);

  // Chooses the hold-out rows and the input scaling. To be called for a resumed ensemble, too: of
  // the state that Visit* show, the call writes only the scaling, with the same numbers.
  Status StartTraining(const DynamicsData<Scalar>& data);
  // Trains on up to `max_updates` minibatches, fewer if an epoch or the training ends. The end of
  // an epoch evaluates the hold-out rows. Does nothing once the training has finished.
  DynamicsProgress Train(const DynamicsData<Scalar>& data, int64_t max_updates);
  // Restores each member's best weights. Train calls this when the training finishes.
  void FinishTraining();
  // One gradient step on at most batch_size given columns (observations | actions, already scaled);
  // the members share the rows of `inputs`, or have a block of rows each. Returns the loss without
  // DecayLoss(). For tests and benchmarks.
  double UpdateOnBatch(MatrixView<const Scalar> inputs, MatrixView<const Scalar> targets);

  // The decay term of the loss at the present weights.
  double DecayLoss() const;

  const DynamicsEnsembleOptions& options() const { return options_; }
  bool trained() const { return finished_ != 0; }
  // Whether some member had a finite hold-out error after an epoch, so that weights were kept.
  bool HasKeptWeights() const;
  // Whether the counters are such as Train leaves behind with the rows of StartTraining, if there
  // are any: a file's may not be.
  bool CanGoOn() const;
  int output_size() const { return options_.observation_size + 1; }
  // Members of smallest hold-out error, best first; before any epoch the first `elites` members.
  std::vector<int> Elites() const;

  // outputs (output_size x n) = mean + exp(log_var / 2) * noise of member members[i] for column i
  // of `inputs` (observation + action x n). With an empty `penalty` only the drawn members are
  // evaluated; otherwise all members are, and penalty[i] becomes the largest L2 norm of a member's
  // standard deviations. Not const, since prediction uses the ensemble's workspaces.
  void Sample(MatrixView<const Scalar> inputs, std::span<const int> members,
              MatrixView<const Scalar> noise, MatrixView<Scalar> outputs,
              std::span<Scalar> penalty = {});
  // Mean and bounded log-variance of one member (output_size x n each).
  void Predict(int member, MatrixView<const Scalar> inputs, MatrixView<Scalar> mean,
               MatrixView<Scalar> log_var);

  void VisitArrays(const ArrayVisitor<Scalar>& visitor);
  void VisitCounters(const CounterVisitor& visitor);
  // Gradients of the last update, under the names of the parameters; for tests.
  void VisitGradients(const ArrayVisitor<Scalar>& visitor);

 private:
  // Buffers of one predicting thread, for one member's pass over one block of columns.
  struct Scratch {
    MlpWorkspace<Scalar> workspace;
    MatrixBuffer<Scalar> inputs, noise;
    std::vector<int> columns;  // columns of the block that drew the member
  };

  DynamicsEnsemble(const DynamicsEnsembleOptions& options, int threads);

  // Training (dynamics_training.cc).
  Status ValidateData(const DynamicsData<Scalar>& data) const;
  int64_t UpdatesPerEpoch() const;
  void SplitRows(int rows);
  void FitScaler(const DynamicsData<Scalar>& data);
  void ShuffleEpoch();
  void GatherRow(const DynamicsData<Scalar>& data, int row, int block, int column);
  void GatherBatch(const DynamicsData<Scalar>& data, int64_t first, int count);
  // One step of member m's weights; returns the loss and writes column m of
  // member_bounds_gradient_.
  double UpdateMember(int m, MatrixView<const Scalar> inputs, MatrixView<const Scalar> targets,
                      MlpWorkspace<Scalar>& workspace);
  void EndEpoch(const DynamicsData<Scalar>& data);
  void EvaluateHoldout(const DynamicsData<Scalar>& data);
  bool KeepImproved();
  // Prediction (dynamics_ensemble.cc).
  void Scale(MatrixView<Scalar> inputs) const;
  MatrixView<Scalar> ScaledCopy(MatrixView<const Scalar> inputs, Scratch& scratch) const;
  void SampleHead(MatrixView<Scalar> head, MatrixView<const Scalar> noise,
                  MatrixView<Scalar> outputs, Scratch& scratch) const;
  void SampleGroup(int member, MatrixView<const Scalar> inputs, MatrixView<const Scalar> noise,
                   MatrixView<Scalar> outputs, Scratch& scratch) const;
  void SampleDrawn(int member, MatrixView<const Scalar> inputs, std::span<const int> members,
                   MatrixView<const Scalar> noise, MatrixView<Scalar> outputs,
                   Scratch& scratch) const;
  void SamplePenalised(MatrixView<const Scalar> inputs, std::span<const int> members,
                       MatrixView<const Scalar> noise, MatrixView<Scalar> outputs,
                       std::span<Scalar> penalty, Scratch& scratch) const;

  DynamicsEnsembleOptions options_;
  MlpLayout layout_;
  TrainedVector<Scalar> weights_;  // weights of all members
  TrainedVector<Scalar> bounds_;   // max_log_var, then min_log_var
  AlignedVector<Scalar> best_weights_;
  AlignedVector<Scalar> scaler_;    // input mean, then 1 / deviation
  AlignedVector<Scalar> best_mse_;  // per member
  int64_t epoch_ = 0;
  int64_t updates_ = 0;
  int64_t updates_in_epoch_ = 0;
  int64_t epochs_without_improvement_ = 0;
  int64_t finished_ = 0;  // 1 once the training has finished

  // State derived from the data and the epoch number; never saved.
  std::vector<int32_t> train_rows_, holdout_rows_;
  std::vector<int32_t> order_;  // positions in train_rows_, in the order of order_epoch_
  int64_t order_epoch_ = -1;
  std::vector<double> holdout_mse_;
  double train_loss_ = 0;

  std::shared_ptr<ThreadTeam> team_;
  std::vector<MlpWorkspace<Scalar>> workspaces_;  // per thread, for a member and batch_size columns
  std::vector<Scratch> scratch_;                  // per thread
  MatrixBuffer<Scalar> inputs_;                   // (members or 1) * inputs x batch
  MatrixBuffer<Scalar> targets_;                  // (members or 1) * outputs x batch
  MatrixBuffer<Scalar> member_bounds_gradient_;   // max, then min x members
  std::vector<double> member_loss_;
};

}  // namespace b4mrl

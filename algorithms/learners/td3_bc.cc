// TD3 with behaviour cloning, offline (Fujimoto and Gu 2021; hyperparameters of the authors' code).
//
//   D      dataset of (s, a, r, s', d), as the daemon serves it, corrupted if so asked
//   pi, Q  deterministic actor and twin critics (rl/td3_core.h, which holds the losses)
//
//   normalise:  s <- (s - mean) / (std + 0.001), mean and std over D's observations
//   repeat:     a batch from D; one step of Q; every second time one of
//               pi towards  lambda Q_1(s, pi(s)) - (pi(s) - a)^2,  lambda = bc-alpha / mean |Q_1|
//
// The normaliser belongs to the policy and is saved with it. Batches stream in ahead of their use.
#include <algorithm>
#include <memory>
#include <optional>
#include <utility>

#include "algorithms/learners/learners.h"
#include "algorithms/rl/batch_buffer.h"
#include "algorithms/rl/core_metrics.h"
#include "algorithms/rl/core_options.h"
#include "algorithms/rl/hidden_dimensions.h"
#include "algorithms/rl/normaliser.h"
#include "algorithms/rl/td3_core.h"
#include "algorithms/rl/training_dataset.h"
#include "client/client.h"
#include "client/remote_dataset.h"

namespace b4mrl {
namespace {

constexpr Hyperparameter kHyperparameters[] = {
    {"bc-alpha", 2.5, 0, 1e6, false, "weight of the value against cloning"},
    {"batch-size", 256, 1, 65'536, true, "rows of one update"},
    {"hidden-width", 256, 1, 4096, true, "units of each of the two hidden layers"},
    {"learning-rate", 3e-4, 1e-8, 1, false, "Adam's, of actor and critics"},
    {"gamma", 0.99, 0, 1, false, "discount"},
    {"tau", 0.005, 0, 1, false, "how far the targets follow in one update"},
    {"policy-noise", 0.2, 0, 10, false, "deviation of the target action's noise"},
    {"noise-clip", 0.5, 0, 10, false, "largest noise of the target action"},
    {"policy-frequency", 2, 1, 1000, true, "updates of the critics for one of the actor"},
    {"normalise", 1, 0, 1, true, "1: normalise observations, 0: do not"},
};

constexpr double kStdEpsilon = 1e-3;

class Td3Bc : public Learner {
 public:
  Td3Bc(const LearnerContext& context, Td3Core<float> core, std::unique_ptr<RemoteDataset> dataset,
        Normaliser normaliser);

  Status Prepare(Progress& progress) override;
  Status Update(MetricMeans& metrics) override;
  PolicyWeights Policy() const override;
  Status Save(CheckpointWriter& writer) override;
  Status Load(CheckpointReader& reader) override;
  std::string dataset_sha256() const override { return dataset_->in_force().info().sha256(); }

 private:
  void StartStream();

  const LearnerContext& context_;
  Td3Core<float> core_;
  std::unique_ptr<RemoteDataset> dataset_;  // D; the stream points at it
  Normaliser normaliser_;
  std::vector<float> mask_;
  std::vector<float> action_scale_;
  BatchBuffer batch_;
  std::optional<BatchStream> stream_;
};

Td3Bc::Td3Bc(const LearnerContext& context, Td3Core<float> core,
             std::unique_ptr<RemoteDataset> dataset, Normaliser normaliser)
    : context_(context),
      core_(std::move(core)),
      dataset_(std::move(dataset)),
      normaliser_(std::move(normaliser)),
      mask_(
          MaskOfDimensions(dataset_->observation_size(), dataset_->in_force().hidden_dimensions())),
      action_scale_(context.ActionScale()),
      batch_(context.observation_size(), context.action_size(),
             context.hyperparameters.Integer("batch-size")) {}

// Batch b is a function of (seed, b), so a resumed learner asks on where it stopped.
void Td3Bc::StartStream() {
  stream_.emplace(dataset_->Stream(static_cast<uint32_t>(batch_.size()),
                                   RoleSeed(context_.seed, "batches"),
                                   static_cast<uint64_t>(core_.updates())));
}

Status Td3Bc::Prepare(Progress&) {
  StartStream();
  return Status();
}

Status Td3Bc::Update(MetricMeans& metrics) {
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows rows, stream_->Next());
  normaliser_.Apply(rows.observations, batch_.observations.view());
  normaliser_.Apply(rows.next_observations, batch_.next_observations.view());
  batch_.SetActions(rows.actions, action_scale_);
  batch_.SetOutcomes(rows.rewards, rows.terminals);
  AddMetrics(core_.Update(batch_.view()), metrics);
  return Status();
}

PolicyWeights Td3Bc::Policy() const {
  PolicyWeights weights = core_.Policy();
  weights.observation_mean = normaliser_.mean;
  weights.observation_std = normaliser_.std;
  weights.observation_mask = mask_;
  return weights;
}

Status Td3Bc::Save(CheckpointWriter& writer) {
  core_.VisitArrays(writer.Arrays("core"));
  core_.VisitCounters(writer.Counters("core"));
  writer.Floats("normaliser/mean", normaliser_.mean);
  writer.Floats("normaliser/std", normaliser_.std);
  writer.Text("dataset", dataset_->fingerprint());
  return Status();
}

Status Td3Bc::Load(CheckpointReader& reader) {
  core_.VisitArrays(reader.Arrays("core"));
  core_.VisitCounters(reader.Counters("core"));
  reader.FloatsInto("normaliser/mean", normaliser_.mean);
  reader.FloatsInto("normaliser/std", normaliser_.std);
  B4MRL_RETURN_IF_ERROR(CheckSameDataset(reader, *dataset_));
  StartStream();
  return Status();
}

}  // namespace

std::span<const Hyperparameter> Td3BcHyperparameters() { return kHyperparameters; }

Result<std::unique_ptr<Learner>> CreateTd3Bc(const LearnerContext& context) {
  B4MRL_ASSIGN_OR_RETURN(Td3Core<float> core,
                         Td3Core<float>::Create(Td3OptionsOf(context, context.observation_size())));
  B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<RemoteDataset> dataset, OpenTrainingDataset(context));
  B4MRL_ASSIGN_OR_RETURN(const DatasetStats stats, dataset->Stats());
  Normaliser normaliser = Normaliser::Of(stats, kStdEpsilon);
  if (context.hyperparameters.Integer("normalise") == 0) {
    normaliser.mean.assign(normaliser.mean.size(), 0.0f);
    normaliser.std.assign(normaliser.std.size(), 1.0f);
  }
  return std::unique_ptr<Learner>(
      std::make_unique<Td3Bc>(context, std::move(core), std::move(dataset), std::move(normaliser)));
}

}  // namespace b4mrl

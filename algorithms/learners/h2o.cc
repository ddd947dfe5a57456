// H2O: hybrid offline-and-online learning that trusts a simulator as far as discriminators say
// (Niu et al. 2022; the authors' code is t6-thu/H2O).
//
//   D          dataset of real transitions (s, a, r, s', d), corrupted if so asked
//   B          all simulated transitions so far; batches are drawn from the newest
//              `replay-capacity`
//   pi, Q      actor and twin critics        D_sa, D_sas   discriminators: real or simulated?
//
//   repeat:  every `updates-per-cycle` updates, B <- B + `steps-per-cycle` steps of a ~ pi(s) in
//            the simulator, whose episodes run on from cycle to cycle
//            discriminators: a batch of `discriminator-batch` rows from each of D and B
//            pi, Q: a batch of `real-ratio` rows from D, the rest from B; errors of simulated rows
//            weigh min(p_real / p_sim, 1), and Q falls where the simulator is wrong
//            (rl/h2o_core.h and rl/h2o_losses.h have the losses)
//
// The gap between the dynamics at (s, a) is estimated around s' with normal noise. Its deviation is
// the authors' by default, which is about 0.3 of D's (GapNoiseStd in rl/h2o_core.h).
//
// A policy sees what D shows: dimensions hidden there are zero in B as well. There is no warm-up.
// An episode that ends by the step limit keeps d = 0.
#include <fmt/format.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/cores/h2o_core.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/online_lanes.h"
#include "algorithms/experience/training_dataset.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/learners.h"
#include "algorithms/policy/observation_mask.h"

namespace b4mrl {
namespace {

constexpr std::string_view kAuthors = "t6-thu/H2O, which the paper's authors ran";

constexpr Hyperparameter kHyperparameters[] = {
    {"lanes", 1, 1, 1024, true, "simulators stepped at once", "environments", kAuthors},
    {"steps-per-cycle", 1000, 1, 1e9, true, "taken in the simulator at once", "transitions",
     kAuthors},
    {"updates-per-cycle", 1000, 1, 1e9, true, "from one turn in the simulator to the next",
     "updates", kAuthors},
    {"replay-capacity", 1e7, 1, 1e9, true, "newest simulated ones that batches are drawn from",
     "transitions", "ours: t6-thu/H2O has ten times the dataset's rows; a run is shorter"},
    {"batch-size", 256, 2, 65'536, true, "of one update of actor and critics", "transitions",
     kAuthors},
    {"real-ratio", 0.5, 0, 1, false, "share of the dataset in them", "", kAuthors},
    {"discriminator-batch", 256, 1, 32'768, true, "of one update, real and simulated each",
     "transitions", kAuthors},
    {"discriminator-noise", 0.1, 0, 1e3, false, "deviation added to the discriminators' inputs", "",
     kAuthors},
    {"gap-weight", 0.01, 0, 1e6, false, "of the penalty on values where the simulator is wrong", "",
     kAuthors},
    {"gap-samples", 10, 1, 1024, true, "noisy copies of s' for an estimate of the gap", "copies",
     kAuthors},
    {"gap-noise", 1, 0, 1e3, false, "their deviation", "gap-noise-std", kAuthors},
    {"gap-noise-std", 0, 0, 1, true, "over what the deviation of s' is taken", "",
     "padded: t6-thu/H2O, which the paper's authors ran; data: D2C, by the same authors",
     "padded|data"},
    {"gap-max", 10, 1e-9, 1e9, false, "largest estimate; at most 4 occurs", "nats", kAuthors},
    {"gap-limit", 1000, 0, 1e9, false, "of the penalty before its weight", "return", kAuthors},
    {"ratio-min", 1e-5, 1e-9, 1, false, "smallest p_real / p_sim; at least exp(-4) occurs", "",
     kAuthors},
    {"hidden-width", 256, 1, 2048, true, "of each of the two hidden layers", "units", kAuthors},
    {"learning-rate", 3e-4, 1e-8, 1, false, "Adam's, of all networks and the entropy weight", "",
     kAuthors},
    {"gamma", 0.99, 0, 1, false, "discount", "", kAuthors},
    {"tau", 0.005, 0, 1, false, "how far the targets follow in one update", "", kAuthors},
    {"initial-alpha", 1, 1e-9, 1e3, false, "entropy weight at the start", "", kAuthors},
};

H2oOptions CoreOptions(const LearnerContext& context, const DatasetStats& stats) {
  const Hyperparameters& values = context.hyperparameters;
  H2oOptions options;
  SetSacOptions(context, context.observation_size(), options);
  options.discriminator_batch_max = 2 * values.Integer("discriminator-batch");
  options.discriminator_learning_rate = values.Number("learning-rate");
  options.discriminator_noise = values.Number("discriminator-noise");
  options.ratio_min = values.Number("ratio-min");
  options.gap_samples = values.Integer("gap-samples");
  options.gap_noise = GapNoise(stats.observation_mean, stats.observation_std,
                               static_cast<GapNoiseStd>(values.Integer("gap-noise-std")),
                               values.Number("gap-noise"));
  options.gap_max = values.Number("gap-max");
  options.gap_weight = values.Number("gap-weight");
  options.gap_limit = values.Number("gap-limit");
  return options;
}

class H2o : public Learner {
 public:
  H2o(const LearnerContext& context, H2oCore<float> core, std::unique_ptr<RemoteDataset> dataset,
      OnlineLanes lanes, int real_rows);

  Status Prepare(Progress& progress) override;
  Status Update(MetricMeans& metrics) override;
  PolicyWeights Policy() const override;
  Status Save(CheckpointWriter& writer) override;
  Status Load(CheckpointReader& reader) override;
  uint64_t environment_steps() const override { return lanes_.environment_steps(); }
  std::string dataset_sha256() const override { return dataset_->in_force().info().sha256(); }

 private:
  void StartStream();
  Status Simulate(MetricMeans& metrics);
  Status FillBatches();

  const LearnerContext& context_;
  const uint64_t updates_per_cycle_;
  const int real_rows_;                // of batch_
  const int discriminator_real_rows_;  // of discriminator_batch_
  const std::vector<float> action_scale_;
  H2oCore<float> core_;
  std::unique_ptr<RemoteDataset> dataset_;   // D; the stream points at it
  OnlineLanes lanes_;                        // the simulator, and B
  BatchBuffer batch_, discriminator_batch_;  // real rows first
  std::optional<BatchStream> stream_;        // real rows of both
};

H2o::H2o(const LearnerContext& context, H2oCore<float> core, std::unique_ptr<RemoteDataset> dataset,
         OnlineLanes lanes, int real_rows)
    : context_(context),
      updates_per_cycle_(context.hyperparameters.Unsigned("updates-per-cycle")),
      real_rows_(real_rows),
      discriminator_real_rows_(context.hyperparameters.Integer("discriminator-batch")),
      action_scale_(context.ActionScale()),
      core_(std::move(core)),
      dataset_(std::move(dataset)),
      lanes_(std::move(lanes)),
      batch_(context.observation_size(), context.action_size(), core_.options().batch_max),
      discriminator_batch_(context.observation_size(), context.action_size(),
                           core_.options().discriminator_batch_max) {}

Status H2o::Prepare(Progress&) {
  StartStream();
  return lanes_.Start();
}

// Batch b of D is a function of (seed, b), so a resumed learner asks on where it stopped.
void H2o::StartStream() {
  stream_.emplace(dataset_->Stream(static_cast<uint32_t>(real_rows_ + discriminator_real_rows_),
                                   RoleSeed(context_.seed, "batches"),
                                   static_cast<uint64_t>(core_.updates())));
}

Status H2o::Update(MetricMeans& metrics) {
  if (static_cast<uint64_t>(core_.updates()) % updates_per_cycle_ == 0) {
    B4MRL_RETURN_IF_ERROR(Simulate(metrics));
  }
  B4MRL_RETURN_IF_ERROR(FillBatches());
  AddMetrics(core_.Update({batch_.view(), real_rows_},
                          {discriminator_batch_.view(), discriminator_real_rows_}),
             metrics);
  return Status();
}

Status H2o::Simulate(MetricMeans& metrics) {
  const uint64_t steps = context_.hyperparameters.Unsigned("steps-per-cycle");
  B4MRL_ASSIGN_OR_RETURN(const FixedOrderPolicy policy, FixedOrderPolicy::Create(core_.Policy()));
  for (uint64_t step = 0; step < steps; step += lanes_.count()) {
    B4MRL_RETURN_IF_ERROR(lanes_.Step(policy, metrics));
  }
  if (lanes_.replay().size() > 0) return Status();
  return Status(StatusCode::kFailedPrecondition,
                "no step of the first cycle led to a state that the simulator could give");
}

Status H2o::FillBatches() {
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows rows, stream_->Next());
  batch_.SetRows(rows, 0, real_rows_, action_scale_);
  discriminator_batch_.SetRows(rows, real_rows_, discriminator_real_rows_, action_scale_);
  batch_.ClipActions(real_rows_);  // as the authors' code clips D's
  discriminator_batch_.ClipActions(discriminator_real_rows_);
  Rng rng(RoleSeed(context_.seed, "replay"), "rows", static_cast<uint64_t>(core_.updates()));
  lanes_.replay().Sample(rng, real_rows_, batch_.size() - real_rows_, batch_);
  lanes_.replay().Sample(rng, discriminator_real_rows_,
                         discriminator_batch_.size() - discriminator_real_rows_,
                         discriminator_batch_);
  return Status();
}

PolicyWeights H2o::Policy() const {
  PolicyWeights policy = core_.Policy();
  policy.observation_mask = lanes_.policy_mask();
  return policy;
}

Status H2o::Save(CheckpointWriter& writer) {
  writer.State("core", core_);
  writer.Text("dataset", dataset_->fingerprint());
  return lanes_.Save(writer);
}

Status H2o::Load(CheckpointReader& reader) {
  reader.StateInto("core", core_);
  B4MRL_RETURN_IF_ERROR(CheckSameDataset(reader, *dataset_));
  StartStream();
  return lanes_.Load(reader);
}

}  // namespace

std::span<const Hyperparameter> H2oHyperparameters() { return kHyperparameters; }

Status CheckH2o(const LearnerContext& context) {
  const Hyperparameters& values = context.hyperparameters;
  const int batch_size = values.Integer("batch-size");
  const int real_rows = RealRows(values);
  if (real_rows < 1 || real_rows >= batch_size) {
    return InvalidNumber("real-ratio", values.Number("real-ratio"),
                         "at least one real and one simulated row in a batch");
  }
  B4MRL_RETURN_IF_ERROR(CheckRowsPerUpdate(
      context, "batch-size * real-ratio + discriminator-batch",
      static_cast<uint64_t>(real_rows) + values.Unsigned("discriminator-batch")));
  const int most = MaxGapSamples(context.observation_size(), batch_size);
  if (values.Integer("gap-samples") <= most) return Status();
  return InvalidNumber("gap-samples", values.Number("gap-samples"),
                       fmt::format("1..{} with a batch-size of {} and {} values in an observation",
                                   most, batch_size, context.observation_size()));
}

Result<std::unique_ptr<Learner>> CreateH2o(const LearnerContext& context) {
  B4MRL_RETURN_IF_ERROR(CheckH2o(context));
  B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<RemoteDataset> dataset, OpenTrainingDataset(context));
  B4MRL_ASSIGN_OR_RETURN(const DatasetStats stats, dataset->Stats());
  B4MRL_ASSIGN_OR_RETURN(H2oCore<float> core, H2oCore<float>::Create(CoreOptions(context, stats)));
  B4MRL_ASSIGN_OR_RETURN(
      OnlineLanes lanes,
      OnlineLanes::Open(context, MaskOfDimensions(dataset->observation_size(),
                                                  dataset->in_force().hidden_dimensions())));
  return std::unique_ptr<Learner>(std::make_unique<H2o>(context, std::move(core),
                                                        std::move(dataset), std::move(lanes),
                                                        RealRows(context.hyperparameters)));
}

}  // namespace b4mrl

// H2O: hybrid offline-and-online learning that trusts a simulator as far as discriminators say
// (Niu et al. 2022; the authors' code is t6-thu/H2O).
//
//   D          dataset of real transitions (s, a, r, s', d), with corruptions if asked for
//   B          all simulated transitions so far; batches are drawn from the newest
//              `replay-capacity`
//   pi, Q      actor and twin critics        D_sa, D_sas   discriminators: real or simulated?
//
//   repeat:  every `updates-per-cycle` updates, B <- B + `steps-per-cycle` steps of a ~ pi(s) in
//            the simulator, whose episodes run on from cycle to cycle
//            discriminators: a batch of `discriminator-batch` rows from each of D and B
//            pi, Q: a batch of `real-ratio` rows from D, the rest from B; errors of simulated rows
//            weigh min(p_real / p_sim, 1), and Q falls where the simulator is wrong
//            (cores/h2o_core.h and cores/h2o_losses.h have the losses)
//
// The gap between the two dynamics at (s, a) is estimated from noisy copies of s'. By default the
// noise has the standard deviation of the authors' code, which is not that of D's observations
// (GapNoiseStd in cores/h2o_core.h).
//
// The policy sees what D shows: dimensions hidden in D are zero in B, too. There is no warm-up.
// An episode that ends by the step limit keeps d = 0.
#include <fmt/format.h>

#include <memory>
#include <utility>
#include <vector>

#include "algorithms/cores/h2o_core.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/replay_collector.h"
#include "algorithms/experience/training_dataset.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/h2o_options.h"

namespace b4mrl {
namespace {

constexpr std::string_view kAuthors = "t6-thu/H2O, which the paper's authors ran";

class H2o final : public Learner {
 public:
  H2o(const LearnerContext& context, H2oCore<float> core, TrainingDataset dataset,
      ReplayCollector collector);

  Status Prepare(Progress& progress) override;
  Status Update(MetricMeans& metrics) override;
  PolicyWeights Policy() const override;
  Status Save(CheckpointWriter& writer) override;
  Status Load(CheckpointReader& reader) override;
  uint64_t environment_steps() const override { return collector_.environment_steps(); }
  DatasetIdentity dataset_identity() const override { return dataset_.identity(); }

 private:
  uint64_t updates() const { return static_cast<uint64_t>(core_.updates()); }
  Status Simulate(MetricMeans& metrics);
  Status FillBatches();

  const LearnerContext& context_;
  const uint64_t updates_per_cycle_;
  const int real_rows_;                // number of real rows in batch_
  const int discriminator_real_rows_;  // number of real rows in discriminator_batch_
  const std::vector<float> action_scale_;
  H2oCore<float> core_;
  TrainingDataset dataset_;                  // D
  ReplayCollector collector_;                // acts in the simulator, and holds B
  BatchBuffer batch_, discriminator_batch_;  // real rows first
};

H2o::H2o(const LearnerContext& context, H2oCore<float> core, TrainingDataset dataset,
         ReplayCollector collector)
    : context_(context),
      updates_per_cycle_(context.hyperparameters.Unsigned("updates-per-cycle")),
      real_rows_(RealRows(context.hyperparameters)),
      discriminator_real_rows_(context.hyperparameters.Integer("discriminator-batch")),
      action_scale_(context.ActionScale()),
      core_(std::move(core)),
      dataset_(std::move(dataset)),
      collector_(std::move(collector)),
      batch_(context.observation_size(), context.action_size(), core_.options().batch_max),
      discriminator_batch_(context.observation_size(), context.action_size(),
                           core_.options().discriminator_batch_max) {}

Status H2o::Prepare(Progress&) {
  dataset_.Start(0);
  return collector_.Start();
}

Status H2o::Update(MetricMeans& metrics) {
  if (updates() % updates_per_cycle_ == 0) B4MRL_RETURN_IF_ERROR(Simulate(metrics));
  B4MRL_RETURN_IF_ERROR(collector_.KeepSession());  // for the next cycle
  B4MRL_RETURN_IF_ERROR(FillBatches());
  AddMetrics(core_.Update({batch_.view(), real_rows_},
                          {discriminator_batch_.view(), discriminator_real_rows_}),
             metrics);
  return Status();
}

Status H2o::Simulate(MetricMeans& metrics) {
  const uint64_t steps = context_.hyperparameters.Unsigned("steps-per-cycle");
  B4MRL_RETURN_IF_ERROR(collector_.Collect(core_.Policy(), steps, metrics));
  if (collector_.replay().size() > 0) return Status();
  return Status(StatusCode::kFailedPrecondition,
                "no step of the first cycle led to a state that the simulator could give");
}

Status H2o::FillBatches() {
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows real, dataset_.Next());
  Rng rng(RoleSeed(context_.seed, "replay"), "rows", updates());
  const auto fill = [&](BatchBuffer& batch, int first_row, int rows) {
    batch.SetRows(real, first_row, rows, action_scale_);
    batch.ClipActions(rows);  // as the authors' code clips the actions of D
    collector_.replay().Sample(rng, rows, batch.size() - rows, batch);
  };
  fill(batch_, 0, real_rows_);
  fill(discriminator_batch_, real_rows_, discriminator_real_rows_);
  return Status();
}

PolicyWeights H2o::Policy() const { return collector_.WithInputs(core_.Policy()); }

Status H2o::Save(CheckpointWriter& writer) {
  writer.State("core", core_);
  dataset_.Save(writer);
  return collector_.Save(writer);
}

Status H2o::Load(CheckpointReader& reader) {
  reader.StateInto("core", core_);
  B4MRL_RETURN_IF_ERROR(dataset_.Load(reader, updates()));
  return collector_.Load(reader);
}

Status Check(const LearnerContext& context) {
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

Result<std::unique_ptr<Learner>> Create(const LearnerContext& context) {
  B4MRL_RETURN_IF_ERROR(Check(context));
  const Hyperparameters& values = context.hyperparameters;
  B4MRL_ASSIGN_OR_RETURN(
      TrainingDataset dataset,
      TrainingDataset::Open(context, RealRows(values) + values.Integer("discriminator-batch")));
  B4MRL_ASSIGN_OR_RETURN(const DatasetStats stats, dataset.remote().Stats());
  B4MRL_ASSIGN_OR_RETURN(H2oCore<float> core, H2oCore<float>::Create(H2oOptionsOf(context, stats)));
  B4MRL_ASSIGN_OR_RETURN(ReplayCollector collector, ReplayCollector::Open(context, dataset.mask()));
  return std::unique_ptr<Learner>(
      std::make_unique<H2o>(context, std::move(core), std::move(dataset), std::move(collector)));
}

HyperparameterTable Table() {
  const HyperparameterTable own = {
      Whole("steps-per-cycle", 1000, {1, 1e5},
            "steps taken in the simulator at the start of each cycle, which no signal interrupts",
            {.unit = "transitions", .source = kAuthors}),
      Whole("updates-per-cycle", 1000, {1, 1e9},
            "length of a cycle: updates from one turn in the simulator to the next",
            {.unit = "updates", .source = kAuthors}),
      Whole("lanes", 1, {1, 1024}, "simulated environments stepped at once",
            {.unit = "environments", .source = kAuthors}),
      Whole("replay-capacity", 1e7, {1, 1e9},
            "size of the replay buffer: batches take the newest simulated transitions",
            {.unit = "transitions",
             .source = "ours: t6-thu/H2O has ten times the dataset's rows; a run is "
                       "shorter"}),
      Real("real-ratio", 0.5, {0, 1},
           "share of a batch of actor and critics that comes from the dataset",
           {.source = kAuthors}),
      Whole("discriminator-batch", 256, {1, 32'768},
            "real transitions, and as many simulated ones, in a batch of the discriminators",
            {.unit = "transitions", .source = kAuthors}),
      Real("discriminator-noise", 0.1, {0, 1e3},
           "standard deviation of the noise added to the discriminators' inputs",
           {.source = kAuthors}),
      Real("gap-weight", 0.01, {0, 1e6},
           "weight of the penalty on values where the simulator is wrong", {.source = kAuthors}),
      Whole("gap-samples", 10, {1, 1024},
            "noisy copies of s' from which the gap between the dynamics is estimated",
            {.unit = "copies", .source = kAuthors}),
      Real("gap-noise", 1, {0, 1e3},
           "standard deviation of the noise added to s' when the gap is estimated",
           {.unit = "gap-noise-std", .source = kAuthors}),
      Choice("gap-noise-std", "padded|data", 0,
             "rows that define gap-noise's unit: the dataset's (data), or the authors' "
             "zero-padded buffer, 0.3 of it where the mean is 0, more elsewhere (padded)",
             "padded: t6-thu/H2O, which the paper's authors ran; data: D2C, by the same "
             "authors"),
      Real("gap-max", 10, {1e-9, 1e9},
           "largest estimate of the gap; estimates above 4 do not occur",
           {.unit = "nats", .source = kAuthors}),
      Real("gap-limit", 1000, {0, 1e9},
           "largest magnitude of the gap's penalty before gap-weight multiplies it",
           {.unit = "return", .source = kAuthors}),
      Real("ratio-min", 1e-5, {1e-9, 1},
           "smallest weight p_real / p_sim of a simulated row; at least exp(-4) occurs",
           {.source = kAuthors}),
      InitialAlphaRow(kAuthors),
  };
  return own + ActorCriticRows(kAuthors);
}

}  // namespace

Algorithm H2oAlgorithm() {
  return {.name = "h2o",
          .description =
              "model-free hybrid: SAC on data and in a simulator, trusted as far as "
              "discriminators say",
          .needs = {.simulator = true, .dataset = true},
          .hyperparameters = Table(),
          .create = Create,
          .check = Check};
}

}  // namespace b4mrl

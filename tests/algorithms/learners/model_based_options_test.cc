#include "algorithms/learners/model_based_options.h"

#include <catch2/catch.hpp>
#include <vector>

#include "proto/base/folders.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

// No value is a default of the ensemble's or of the rollouts', and no two numbers are equal.
constexpr Hyperparameter kTable[] = {
    {"ensemble-members", 6, 1, 64, true, ""},
    {"ensemble-elites", 4, 1, 64, true, ""},
    {"ensemble-width", 24, 1, 64, true, ""},
    {"ensemble-initialisation", 1, 0, 1, true, "", {}, {}, "torch|truncated-normal"},
    {"ensemble-learning-rate", 0.25, 0, 1, false, ""},
    {"ensemble-batch-size", 48, 1, 64, true, ""},
    {"decay-factor", 0.75, 0, 1, false, ""},
    {"bootstrap", 1, 0, 1, true, "", {}, {}, "false|true"},
    {"input-scaling", 1, 0, 1, true, "", {}, {}, "false|true"},
    {"holdout", 1, 0, 1, true, "", {}, {}, "tail|permutation"},
    {"holdout-fraction", 0.375, 0, 1, false, ""},
    {"holdout-max", 77, 1, 100, true, ""},
    {"ensemble-max-updates", 99, 1, 100, true, ""},
    {"ensemble-patience", 8, 1, 64, true, ""},
    {"ensemble-cache", 0, 0, 1, true, "", {}, {}, "false|true"},
    {"horizon", 7, 1, 64, true, ""},
    {"penalty", 0.625, 0, 1, false, ""},
    {"chunk-rows", 30, 1, 64, true, ""},
    {"chunks-in-flight", 3, 1, 64, true, ""},
};

LearnerContext ContextOf(std::span<const Hyperparameter> table) {
  LearnerContext context;
  context.environment.observation.dimensions.resize(11);
  for (const double bound : {0.5, 2.0}) {
    context.environment.action.dimensions.push_back({"", "", -bound, bound, ""});
  }
  context.environment.termination = std::vector<DimensionBounds>{{0, 0.8, 2}};
  context.seed = 5;
  context.precision = Precision::kBf16;
  context.folder = "run";
  context.hyperparameters = Hyperparameters(table);
  return context;
}

TEST_CASE("a model-based learner's hyperparameters reach its ensemble") {
  const DynamicsEnsembleOptions options = EnsembleOptionsOf(ContextOf(kTable));
  CHECK(options.observation_size == 11);
  CHECK(options.action_size == 2);
  CHECK(options.members == 6);
  CHECK(options.elites == 4);
  CHECK(options.hidden == std::vector<int>{24, 24, 24, 24});
  CHECK(options.initialization == Initialization::kTruncatedNormal);
  CHECK(options.learning_rate == 0.25);
  CHECK(options.batch_size == 48);
  CHECK(options.decay_scale == 0.75);
  CHECK(options.bootstrap);
  CHECK(options.scale_inputs);
  CHECK(options.holdout_rule == HoldoutRule::kPermutation);
  CHECK(options.holdout_fraction == 0.375);
  CHECK(options.holdout_max == 77);
  CHECK(options.max_updates == 99);
  CHECK(options.patience_epochs == 8);
  CHECK(options.seed == RoleSeed(5, "ensemble"));
  CHECK(options.precision == Precision::kBf16);
}

TEST_CASE("a model-based learner's hyperparameters reach its rollouts") {
  const LearnerContext context = ContextOf(kTable);
  std::vector<float> mask(11, 1.0f);
  mask[9] = 0;
  const ModelRolloutOptions options =
      RolloutOptionsOf(context, mask, Take(Termination::Of(context.environment)));
  CHECK(options.observation_size == 11);
  CHECK(options.action_size == 2);
  CHECK(options.horizon == 7);
  CHECK(options.penalty == 0.625);
  CHECK(options.chunk_rows == 30);
  CHECK(options.chunks_in_flight == 3);
  CHECK(options.seed == RoleSeed(5, "rollouts"));
  CHECK(options.action_scale == std::vector<float>{0.5f, 2.0f});
  CHECK(options.mask == mask);
  REQUIRE(options.termination);
  CHECK(options.termination->Ends(std::vector<float>(11, 0.5f)));
  CHECK_FALSE(options.termination->Ends(std::vector<float>(11, 1.5f)));
}

TEST_CASE("a learner without a simulator rolls out one chunk at a time") {
  // The table's last two rows are those of queries.
  const LearnerContext context = ContextOf(std::span(kTable).first(std::size(kTable) - 2));
  const ModelRolloutOptions options = RolloutOptionsOf(context, {}, {});
  CHECK(options.chunk_rows == ModelRolloutOptions().chunk_rows);
  CHECK(options.chunks_in_flight == 1);
  CHECK(options.mask.empty());
  CHECK_FALSE(options.termination);
}

TEST_CASE("trained ensembles are kept in the run's folder, and in the cache if asked for") {
  LearnerContext context = ContextOf(kTable);
  CHECK(EnsembleFilesOf(context).run_folder == "run");
  CHECK(EnsembleFilesOf(context).cache_folder.empty());
  RequireOk(context.hyperparameters.Set("ensemble-cache", 1));
  CHECK(EnsembleFilesOf(context).cache_folder == DefaultCacheFolder());
}

}  // namespace
}  // namespace b4mrl

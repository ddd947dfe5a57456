// What users may set of a model-based learner, and the options that it becomes.
#pragma once

#include <optional>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/model/ensemble_store.h"
#include "algorithms/model/model_rollout.h"
#include "algorithms/model/termination.h"

namespace b4mrl {

// The rows that MOPO's and HyMOPO's tables share, and their row `penalty`.
HyperparameterTable ModelBasedRows();
Hyperparameter PenaltyRow(double value, std::string_view source);

DynamicsEnsembleOptions EnsembleOptionsOf(const LearnerContext& context);
// kInvalidArgument for more elites than members, for an ensemble that its file would not hold, and
// for more rows of the dataset in a batch than a request holds.
Status CheckModelBased(const LearnerContext& context);
EnsembleFiles EnsembleFilesOf(const LearnerContext& context);
// `mask`: of an observation. Without chunk-rows and chunks-in-flight in the table, nothing is asked
// of a simulator: one chunk at a time.
ModelRolloutOptions RolloutOptionsOf(const LearnerContext& context, std::vector<float> mask,
                                     std::optional<Termination> termination);

}  // namespace b4mrl

// Hyperparameters of model-based learners, and the options of ensemble and rollouts made from them.
#pragma once

#include <optional>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/model/ensemble_store.h"
#include "algorithms/model/model_rollout.h"
#include "algorithms/model/termination.h"

namespace b4mrl {

// Hyperparameters that MOPO and HyMOPO share, and `penalty`, whose default differs between them.
HyperparameterTable ModelBasedRows();
Hyperparameter PenaltyRow(double value, std::string_view source);

DynamicsEnsembleOptions EnsembleOptionsOf(const LearnerContext& context);
// kInvalidArgument for more elites than ensemble members, for an ensemble too large for its file,
// and for more dataset rows in a batch than one request holds.
Status CheckModelBased(const LearnerContext& context);
EnsembleFiles EnsembleFilesOf(const LearnerContext& context);
// `mask`: the dimensions of an observation that the policy may see (TrainingDataset::mask). A
// learner without a simulator has no chunk-rows and chunks-in-flight: one chunk at a time.
ModelRolloutOptions RolloutOptionsOf(const LearnerContext& context, std::vector<float> mask,
                                     std::optional<Termination> termination);

}  // namespace b4mrl

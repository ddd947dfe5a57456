// What list.cc takes from each learner's file.
#pragma once

#include <memory>
#include <span>

#include "algorithms/base/learner.h"

namespace b4mrl {

std::span<const Hyperparameter> SacHyperparameters();
Result<std::unique_ptr<Learner>> CreateSac(const LearnerContext& context);

std::span<const Hyperparameter> Td3Hyperparameters();
Result<std::unique_ptr<Learner>> CreateTd3(const LearnerContext& context);

std::span<const Hyperparameter> Td3BcHyperparameters();
Result<std::unique_ptr<Learner>> CreateTd3Bc(const LearnerContext& context);

std::span<const Hyperparameter> IqlHyperparameters();
Result<std::unique_ptr<Learner>> CreateIql(const LearnerContext& context);

std::span<const Hyperparameter> MopoHyperparameters();
Result<std::unique_ptr<Learner>> CreateMopo(const LearnerContext& context);

std::span<const Hyperparameter> H2oHyperparameters();
Result<std::unique_ptr<Learner>> CreateH2o(const LearnerContext& context);
Status CheckH2o(const LearnerContext& context);

std::span<const Hyperparameter> HymopoHyperparameters();
Result<std::unique_ptr<Learner>> CreateHymopo(const LearnerContext& context);

}  // namespace b4mrl

// Whether a result is what it says: its entries, its names, its ids, and its figures among
// themselves. What others submit is checked by it (benchmarks/RULES.md). Thread rule: one thread.
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "algorithms/datasets/published_datasets.h"
#include "benchmarks/plan/budget.h"
#include "benchmarks/plan/plan.h"
#include "data/suites/suites.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

struct CheckSources {
  std::vector<Benchmark> benchmarks;
  std::vector<Budget> budgets;  // of the project, whose names stand for what they say
  PlanSources plan;
  const PublishedDatasets* published = nullptr;
  std::function<Result<EnvironmentSpec>(const std::string& name)> find_environment;
};

// What plans for a result ask of the rest of the program. A dataset without a recipe, the user's
// own or D4RL's, holds what the result says: whoever checks it need not have it. `result` outlives
// it.
PlanSources PlanSourcesFor(const nlohmann::ordered_json& result, const CheckSources& sources);

// The run of a result, with its ids. kUnknownName and others where its entries make none.
Result<PlannedRun> RunOfResult(const nlohmann::ordered_json& result, const CheckSources& sources);

// The perturbations of the true environment under which a result's agent was scored: its world and,
// for a learner of the user's own, what its benchmark hides.
Result<std::string> ScoredUnder(const nlohmann::ordered_json& result, const CheckSources& sources);

// What is wrong with the result that was read from the file, whose name it has to fit, one line
// each; none: nothing is. Its agent (agent_check.h) and other results (copied_seeds.h) are not
// looked at.
std::vector<std::string> FaultsOf(const nlohmann::ordered_json& result, const std::string& file,
                                  const CheckSources& sources);

}  // namespace b4mrl

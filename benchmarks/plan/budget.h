// Budgets: how long the runs of a suite train, and the hyperparameters that differ from the
// learners' defaults. A file holds one table a budget (benchmarks/budgets.toml):
//
//   [small]
//   precision = "fp32"
//   precisions = { h2o = "fp32" }   # of algorithms that differ
//   recipes = { mopo = "short" }    # names, for tables, of what the hyperparameters below choose
//   learner-updates = 100_000       # of a learner of the user's own
//   evaluations = 50        # of a run, at equal distances
//   episodes = 10           # of an evaluation
//   rows = 10_000           # of each dataset that has a recipe, at most; left out: all
//   seeds = 1               # runs of each cell, seeds 0, 1, ...
//   [small.updates]         # by algorithm; an algorithm that is left out does not run
//   sac = 250_000
//   [small.hyperparameters.mopo]  # numbers, true or false, and names of choices
//   rollout-lag = 1
//   [[small.exception]]     # for the runs that fit all of its lists; the last one that fits counts
//   algorithms = ["sac", "td3"]
//   simulators = ["gravity"]    # `b4mrl report --at` asks for presets by their names
//   datasets = ["medium"]
//   updates = 1_000_000
//   hyperparameters = { warm-up = 1_000 }
//
// Value types; any thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// Hyperparameters by name, as `b4mrl train` takes them: "0.0003", "gaussian", "true".
using HyperparameterValues = std::map<std::string, std::string>;

// The budget of the commands that are told none.
inline constexpr char kDefaultBudget[] = "small";

struct BudgetException {
  std::vector<std::string> algorithms, simulators, datasets;  // empty: any
  std::optional<uint64_t> updates;
  HyperparameterValues hyperparameters;

  // Whether it is about a run, of which "" says what its algorithm does not use. `dataset` is a
  // name with its environment, "HalfCheetah/medium", or D4RL's dataset of the same level.
  bool Fits(const std::string& algorithm, const std::string& simulator,
            const std::string& dataset) const;
};

struct Budget {
  std::string name;
  std::string precision = "fp32";
  std::map<std::string, std::string> precisions;  // by algorithm, where they differ
  std::map<std::string, std::string> recipes;     // by algorithm; without one the name is ""
  std::optional<uint64_t> learner_updates;
  uint64_t evaluations = 50;
  uint32_t episodes = 10;
  std::optional<uint64_t> rows;
  uint32_t seeds = 1;
  std::map<std::string, uint64_t> updates;                      // by algorithm
  std::map<std::string, HyperparameterValues> hyperparameters;  // by algorithm
  std::vector<BudgetException> exceptions;

  const std::string& PrecisionOf(const std::string& algorithm) const;
  std::string RecipeOf(const std::string& algorithm) const;
  // How far a run of an algorithm trains, exceptions included; nothing where the budget has none.
  // Arguments as of BudgetException::Fits.
  std::optional<uint64_t> UpdatesOf(const std::string& algorithm, const std::string& simulator,
                                    const std::string& dataset) const;
};

// Reads the budget `name` of a file; "" is the only one of a file with one. Errors: kIoError,
// kUnknownName, kInvalidArgument with the file, the table and what is allowed there.
Result<Budget> ReadBudget(const std::string& file, const std::string& name);
// All budgets of a file, by name. Errors as above.
Result<std::vector<Budget>> ReadBudgets(const std::string& file);
// A budget of the project by its name, or the only one of a file: what has a '/' or ends with
// ".toml".
Result<Budget> FindBudget(const std::string& text);
// benchmarks/budgets.toml, where it was installed or in the checkout.
std::string DefaultBudgetsFile();

}  // namespace b4mrl

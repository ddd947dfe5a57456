// A plan: the distinct training runs that fill the cells of benchmarks.
//
// A cell is a benchmark with an algorithm that is defined for it. What the algorithm does not use
// is dropped from the cell, and equal rests are one run: SAC trains once for all datasets that are
// paired with one simulator. A run's id is a hash of everything that decides its numbers but their
// amount: not of its updates, so a larger budget goes on with the same run, and not of threads,
// evaluations or program version. The id of a run's cell leaves out the seed and the precision too:
// results of equal cell ids may be averaged.
//
// A learner of the user's own has one run for each benchmark, as nobody knows what it uses. Its id
// is the hash of {"algorithm", "benchmark", "rows", "seed", "suite"} as JSON, "rows" of the
// dataset; its cell's id leaves out the seed.
// Value types; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/base/learner.h"
#include "benchmarks/plan/budget.h"
#include "data/suites/suites.h"
#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"

namespace b4mrl {

// An evaluation of a run's agent, beside those of its training. "full": it sees what was hidden
// from it; "served": through its noise. kOwnScoring, of a user's learner: as it was trained, which
// is its run's score.
inline constexpr char kOwnScoring[] = "trained";
struct Scoring {
  std::string name;
  std::string simulator;  // perturbations: those of the world, then the noise of its training
  std::string observe;    // of `b4mrl evaluate`: "trained" or "full"
};

struct PlannedRun {
  std::string learner;  // the command of a learner of the user's own; "": one of the project's
  // As the user writes them for `b4mrl train`.
  std::string algorithm, environment, simulator, dataset, corruption, world;
  std::string full_dataset;  // the dataset's name with its version, as its recipe has it
  std::string suite;         // version of its benchmarks' suite: "v0"
  uint64_t seed = 0;
  std::string precision;
  std::string recipe;  // the budget's name for its hyperparameters; "": none
  uint64_t updates = 0;
  HyperparameterValues hyperparameters;  // that differ from the learner's defaults
  std::optional<uint64_t> rows;          // of its dataset, as far as its recipe says
  std::string columns_sha256;            // of its dataset as published; "": any rows will do
  std::string rows_at_hand;  // the same of its dataset as the daemon has it; "": it is not known
  std::vector<Scoring> scorings;
  std::string hidden;  // "hidden=9": what its training did not see, as perturbations

  std::string id;                       // 16 hexadecimal digits
  std::string cell_id;                  // 16 hexadecimal digits
  std::string name;                     // "HalfCheetah-hymopo-gravity-medium-expert+hidden-high-s0"
  std::vector<std::string> benchmarks;  // of the plan, whose cells it fills
  std::vector<std::string> all_benchmarks;  // whose cells it fills, those of no plan as well

  bool is_users() const { return !learner.empty(); }
};

// Whether a name can be that of a learner of the user's own: it has 1 to kMostNameCharacters
// letters, digits and dashes.
inline constexpr size_t kMostNameCharacters = 40;
bool IsLearnerName(std::string_view name);
// Whether a learner of the user's own of that name would pass for one of these: letters of either
// case are the same, since reports write "TD3-BC" for td3-bc.
bool IsNameOfAlgorithm(const std::string& name, std::span<const Algorithm> algorithms);

// What a plan asks of the rest of the program.
struct PlanSources {
  std::span<const Algorithm> algorithms;
  const pb::CatalogueReply* catalogue = nullptr;  // for presets and their parametric forms
  // What a dataset of that name will hold, whether or not it is made: its recipe, an object with
  // the full name as "name", rows and hashes.
  std::function<Result<nlohmann::json>(const std::string& dataset)> describe_dataset;
};

// A learner of the user's own: the name of its algorithm, and the shell's command that runs it.
struct UsersLearner {
  std::string name;
  std::string command;
};

struct PlanChoice {
  std::vector<std::string> algorithms;  // empty: all of the budget
  std::vector<uint64_t> seeds;
  std::optional<UsersLearner> learner;  // instead of the project's
};

// The distinct runs in the order in which the benchmarks first need them, seed by seed. Errors:
// kUnknownName (an algorithm, a hyperparameter), kInvalidArgument (a value out of bounds, a user's
// learner that is named like an algorithm), and those of describe_dataset.
Result<std::vector<PlannedRun>> MakePlan(std::span<const Benchmark> benchmarks,
                                         const Budget& budget, const PlanChoice& choice,
                                         const PlanSources& sources);

// Sets the ids, the names and the scorings of a run whose other fields are given, hyperparameters
// included: of a result that is read again. `rows`: of its dataset. An algorithm that the sources
// do not have is a learner of the user's own, of the run's only benchmark. Errors: those of
// MakePlan.
Status IdentifyRun(PlannedRun* run, std::optional<uint64_t> rows, const PlanSources& sources);

// Whether a benchmark's name fits a pattern, in which '*' stands for any text and '?' for any
// character.
bool FitsPattern(const std::string& name, const std::string& pattern);

}  // namespace b4mrl

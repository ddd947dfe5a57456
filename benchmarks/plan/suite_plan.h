// From a user's words to the plan of a suite: which benchmarks, which budget, which seeds.
//
// Thread rule: one thread.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/datasets/published_datasets.h"
#include "benchmarks/plan/budget.h"
#include "benchmarks/plan/plan.h"
#include "client/client.h"
#include "data/suites/suites.h"
#include "proto/base/status.h"

namespace b4mrl {

struct SuiteChoice {
  std::vector<std::string> patterns;  // of benchmarks' names; empty: all
  std::vector<std::string> algorithms;
  std::string seeds;           // "0", "0..2"; "": as many as the budget says
  std::string suites;          // folder of further suites; "": none
  std::string source = "own";  // of the data: "own", or "d4rl" for D4RL's files of the same levels
  std::optional<UsersLearner> learner;
};

// The benchmarks of the project's suites and of those in the folder `suites` ("": none). Datasets
// have the names that plans give them (ShortName). Errors: those of ReadSuites.
Result<std::vector<Benchmark>> ReadBenchmarks(const std::string& suites);

// D4RL's dataset of the same level: "HalfCheetah/medium" is "d4rl/halfcheetah-medium-v2".
std::string OfD4rl(const std::string& dataset);

// What a dataset without a recipe holds, as plans describe it: its rows, not the file that they
// came in, so equal rows make equal ids.
nlohmann::json DescribeRows(const std::string& name, uint64_t rows,
                            const std::string& columns_sha256);

// The benchmarks that the patterns choose. kUnknownName for a pattern that fits none.
Result<std::vector<Benchmark>> ChooseBenchmarks(const SuiteChoice& choice);

// Whether the daemon of `client` has the benchmarks, for which a learner of the user's own asks it;
// the project's learners do not. kFailedPrecondition: it was started without their suite.
Status CheckServed(const std::vector<Benchmark>& benchmarks, Client& client);

// What the names of plans mean: the project's recipes, what the daemon of `client` knows and has.
class PlanKnowledge {
 public:
  // `client` outlives the object, the object its sources.
  static Result<PlanKnowledge> Ask(Client& client);
  PlanSources sources() const;
  const PublishedDatasets& published() const { return published_; }

 private:
  explicit PlanKnowledge(Client& client) : client_(&client) {}
  Client* client_;
  pb::CatalogueReply catalogue_;
  PublishedDatasets published_;
};

struct SuitePlan {
  std::vector<PlannedRun> runs;
  // Why runs are not among them, a line for each dataset: no agent of the project has its level,
  // and the data folder has none that somebody made with an agent of their own.
  std::vector<std::string> left_out;
};

// `client` is connected to a daemon on the data folder.
Result<SuitePlan> PlanSuite(const SuiteChoice& choice, const Budget& budget, Client& client);

}  // namespace b4mrl

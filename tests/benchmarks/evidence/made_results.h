// Results for tests, written as the runner writes them.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "benchmarks/evidence/score_table.h"
#include "data/suites/suites.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {

struct MadeResult {
  std::string algorithm;
  std::vector<std::string> benchmarks;
  double score = 0;
  uint64_t seed = 0;
  std::string recipe;
  std::string cell;  // "": the algorithm's with its recipe and benchmarks
  std::string rows;  // a hash; "": those published
  bool settled = true;
  double rise = 1;  // points an evaluation, if it has not settled
  std::string source = "own";
  uint64_t updates = 1000;
  std::string dataset = "HalfCheetah/medium-v0";
  std::string precision = "fp32";
};

// The project's datasets.
inline const PublishedDatasets& Published() {
  static const PublishedDatasets published = Take(ReadPublishedDatasets());
  return published;
}

// A finished run, evaluated after each tenth of its updates.
inline nlohmann::ordered_json JsonOf(const MadeResult& made) {
  nlohmann::ordered_json curve = nlohmann::ordered_json::array();
  for (int i = 1; i <= 10; ++i) {
    const double score = made.settled ? made.score : made.score - (10 - i) * made.rise;
    curve.push_back({made.updates / 10 * static_cast<uint64_t>(i), 0, score * 100, 5.0, score});
  }
  std::string cell = made.cell;
  if (cell.empty()) cell = made.algorithm + made.recipe + made.benchmarks.front();
  nlohmann::ordered_json json = {
      {"id", cell + std::to_string(made.seed)},
      {"cell", cell},
      {"benchmarks", made.benchmarks},
      {"suite", "v0"},
      {"algorithm", made.algorithm},
      {"seed", made.seed},
      {"dataset",
       {{"name", made.dataset},
        {"rows", 1000},
        {"columns_sha256",
         made.rows.empty() ? Published().at("HalfCheetah/medium-v0").columns_sha256 : made.rows}}},
      {"budget", "small"},
      {"precision", made.precision},
      {"source", made.source},
      {"updates", made.updates},
      {"finished", true},
      {"seconds", 1800},
      {"version", "0.1.0"},
      {"processor", "AMD EPYC"},
      {"ledger", {{"simulator_steps", 1}, {"query_rows", 2}, {"dataset_rows", 3}}},
      {"sessions", {{{"blas_kernel", "Cooperlake"}}}},
      {"scorings", {{"full", {{"score", made.score + 1}, {"return", 7}}}}},
      {"curve", curve}};
  if (!made.recipe.empty()) json["recipe"] = made.recipe;
  return json;
}

// A folder of them.
class MadeResults {
 public:
  explicit MadeResults(const std::vector<MadeResult>& results) {
    for (const MadeResult& result : results) Add(JsonOf(result).dump());
  }
  void Add(const std::string& text) {
    WriteBytes(folder_.File("result-" + std::to_string(count_++) + ".json"), text);
  }
  // `benchmarks` outlive the table.
  ScoreTable Read(const std::vector<Benchmark>& benchmarks, const ReadingLimit& limit = {},
                  const std::map<std::string, std::string>& main_recipes = {}) const {
    return Take(ScoreTable::Read(folder_.path(), benchmarks, limit, main_recipes, Published()));
  }
  std::string path() const { return folder_.path(); }

 private:
  TemporaryFolder folder_;
  int count_ = 0;
};

// The project's own.
inline const std::vector<Benchmark>& OwnBenchmarks() {
  static const std::vector<Benchmark> benchmarks = Take(ReadSuites({DefaultSuitesFolder()}));
  return benchmarks;
}

}  // namespace b4mrl

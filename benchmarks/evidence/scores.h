// The score of an algorithm on a benchmark with what is known of its error: from results, or as the
// paper prints it. Claims and rank correlations are tested on either in the same way.
//
// The error of a cell with three seeds or more is that of a mean, by Student's t. A cell with fewer
// seeds borrows the algorithm's deviation between seeds in that environment: pooled over our cells
// with three seeds or more once there are ten of those, over the paper's cells before. The number
// of evaluation episodes says nothing about an algorithm and enters nowhere. Value types; any
// thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "benchmarks/evidence/score_table.h"
#include "benchmarks/statistics/estimates.h"
#include "data/suites/suites.h"

namespace b4mrl {

struct CellScore {
  std::string recipe;  // of its series; "" for the paper's, and for algorithms with a single one
  double mean = 0;
  double std = 0;  // between seeds, divided by their number; 0 with one seed
  size_t seeds = 0;
  bool has_other_rows = false;  // its runs have other rows than those published as their dataset
  bool settled = true;
  bool surely_settled = true;        // Cell::IsSurelySettled
  Course course = Course::kSettled;  // of ours: why it has not settled
  // The mean over the seeds of the scores in the last fifth of the runs, where there is one.
  std::optional<double> last_fifth;
  // Points that another doubling of the updates adds, by the second half of each seed's curve: the
  // mean over the seeds (growth.h). Nothing for the paper's, and where a curve does not say.
  std::optional<double> gain_per_doubling;
  // A user's algorithm that has used a simulator or a dataset alone.
  bool has_one_source = false;
  // Of the mean; infinite where nothing is known: a user's algorithm with fewer than three seeds.
  double standard_error = std::numeric_limits<double>::infinity();
  double degrees = std::numeric_limits<double>::infinity();  // of freedom, of Student's t
  bool is_borrowed = false;                                  // the error is that of other cells
  std::string runs;      // equal for cells that the same runs fill
  uint64_t updates = 0;  // of each of them; 0 for the paper's
  // Of ours: the score after fewer updates, wherever another cell of the algorithm has so many.
  std::vector<CellScore> earlier;

  // In which the mean lies with 95% probability; nothing without a standard error.
  std::optional<Interval> Interval95() const;
};

// By benchmark and algorithm.
using CellName = std::pair<std::string, std::string>;
using CellScores = std::map<CellName, CellScore>;

// The score after so many updates, or at the last evaluation before that: itself, if it has no more
// of them, or an earlier one. Null if the runs were not evaluated until then.
const CellScore* ScoreAt(const CellScore& score, uint64_t updates);
// What two scores of one algorithm differ by, where its training must not: that of the longer runs
// as it was when they had as many updates as the others. Nothing if they were not evaluated until
// then, or are by two recipes.
std::optional<std::pair<CellScore, CellScore>> AtEqualUpdates(const CellScore& one,
                                                              const CellScore& other);

// Null if there is none.
const CellScore* Find(const CellScores& scores, const std::string& benchmark,
                      const std::string& algorithm);
// The same of ours that are held against the paper's: those on other rows are other cells.
const CellScore* FindComparable(const CellScores& ours, const std::string& benchmark,
                                const std::string& algorithm);

// What a run of the algorithm on the benchmark depends on, as text: equal for benchmarks that one
// run fills, since an online learner uses no dataset, and an offline one no simulator.
std::string SharedRun(const Benchmark& benchmark, const std::string& algorithm);

// As the paper prints them: three seeds each, all settled.
CellScores PaperScores(const std::vector<Benchmark>& benchmarks);

// The root of the mean square of the deviations that the paper prints, over its distinct runs in an
// environment. Nothing for algorithms that it has not.
std::optional<double> PooledPaperDeviation(const CellScores& paper, const std::string& environment,
                                           const std::string& algorithm);

// Deviations between seeds that cells with fewer than three seeds borrow.
class BorrowedDeviations {
 public:
  BorrowedDeviations() = default;
  BorrowedDeviations(const ScoreTable& table, const CellScores& paper);
  std::optional<double> Of(const std::string& environment, const Series& series) const;

 private:
  using Key = std::pair<std::string, Series>;  // environment first
  std::map<Key, double> deviations_;
};

CellScore ScoreOf(const Benchmark& benchmark, const Cell& cell,
                  const BorrowedDeviations& deviations);
// Of results, each algorithm by its main series, and by another on a benchmark where that has no
// cell; where it has a cell of the recipe, by that one. Runs on other data stand in for no others.
CellScores OwnScores(const ScoreTable& table, const BorrowedDeviations& deviations,
                     const std::string& recipe = "");
// The names of the recipes that stand for no algorithm.
std::set<std::string> OtherRecipes(const ScoreTable& table);

}  // namespace b4mrl

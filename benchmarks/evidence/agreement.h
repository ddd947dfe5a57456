// How far our scores agree with the paper's, by rank: each run counts once, however many benchmarks
// it fills, and those on other rows than the published ones count nowhere. Each figure stands
// between two that need no training:
//   floor    a table that knows algorithm and dataset alone: the mean of the paper's runs of the
//            algorithm and the dataset, and of online learners, which use none, of all their runs
//   ceiling  the paper's numbers with another seed: the mean over 200 draws of each run's score
//            from the normal distribution with its mean and the deviation of one run from such a
//            mean
// and has an interval of 95%: percentile bootstrap, 2,000 resamples of runs, of effects, or of the
// datasets (with their corruptions) that rankings and pairs are of. It says how far the figure
// depends on which cells were run.
// Pure functions; any thread; equal scores give equal numbers.
#pragma once

#include <cstddef>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "benchmarks/evidence/scores.h"
#include "benchmarks/statistics/estimates.h"
#include "data/suites/suites.h"

namespace b4mrl {

struct Agreement {
  std::optional<double> ours, floor, ceiling;  // nothing where ranks are not defined
  std::optional<Interval> interval;            // of `ours`
  size_t count = 0;                            // of runs, effects, rankings or pairs
};

// Two algorithms whose order ours and the paper's rankings can be compared by.
struct PairOrder {
  std::string one, other;
  size_t rankings = 0;            // that hold both
  size_t reversed = 0;            // of them, those that order them otherwise than the paper
  size_t runs = 0;                // different pairs of runs behind the rankings
  size_t reversed_runs = 0;       // of them, those that are reversed
  size_t separated = 0;           // of `runs`, those whose means lie apart in the paper
  size_t reversed_separated = 0;  // of them, those that are reversed
  size_t apart = 0;               // of `separated`, those whose means lie apart here, too
  size_t reversed_apart = 0;      // of them, those that are reversed
};

struct PaperAgreement {
  Agreement scores;  // Spearman
  // Spearman of what a flaw changes: the score minus that of the same algorithm and dataset where
  // nothing else is wrong: with clean data, and in the simulator with the gravity error. Ours are
  // of one recipe and read after equally many updates, and both must have settled there.
  Agreement effects;
  // Mean over benchmarks of Kendall's tau of the algorithms inside one. Of benchmarks that rank the
  // same runs, or some of another's, one counts.
  Agreement rankings;
  // The same over those pairs of algorithms alone whose means in the paper are more than two
  // standard errors of their difference apart. Of the benchmarks with such a pair.
  Agreement separated;
  // The same over the different pairs of runs in the rankings, each once: the share of those in the
  // paper's order minus the share of those in the other.
  Agreement run_pairs;
  // Of these, over the pairs whose means are more than two standard errors of their difference
  // apart, in the paper and in ours.
  Agreement apart;
  // Of `rankings`, in the field's order (OrderOf).
  std::vector<PairOrder> pairs;
};

struct AgreementOptions {
  bool settled_only = true;
  std::set<std::string> without;  // algorithms that are left out
};

PaperAgreement AgreementWith(const CellScores& paper, const CellScores& ours,
                             const std::vector<Benchmark>& benchmarks,
                             const AgreementOptions& options);

}  // namespace b4mrl

// Claims about scores (benchmarks/claims.toml), tested on any scores alike.
//
// A claim compares cells: `higher` is claimed to score above `lower`, by more than a margin. Its
// units are pairs of benchmarks, each with one comparison or several. Two cells of ours of one
// algorithm are compared after equally many updates. A cell that has not settled decides nothing.
// How a claim is tested:
//   "cells"       Every comparison must hold. A comparison is Welch's test of two means.
//   "any"         One algorithm of the upper side must score above the whole lower side in one
//                 unit, by Welch's tests, whose greatest p is multiplied by the number of
//                 algorithms and units that could. Nothing contradicts such a claim.
//   "benchmarks"  Most units must hold. A unit holds if all its comparisons do, and fails if none
//                 does; an exact sign test of either against chances of one half. Where the best of
//                 k algorithms is claimed to be above the best of m, its chance is k / (k + m) if
//                 that is more: so often, one of k that are equally good is the best of all.
//                 Units that the same runs fill count once. An algorithm without a score is left
//                 out of a unit, and named.
// A verdict needs a probability of error of at most 5% over all claims together, by Holm's method.
// Pure functions; any thread.
#pragma once

#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "benchmarks/evidence/scores.h"
#include "data/suites/suites.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ClaimSide {
  std::vector<std::string> algorithms;
  std::vector<std::string> benchmarks;  // names, {} and patterns spelled out
};

enum class ClaimTest { kBenchmarks, kCells, kAny };
// Which of several algorithms are compared: every one with every one, each with itself on the other
// benchmark, or the best of each side.
enum class ClaimPairs { kAll, kSame, kBest };

struct Claim {
  std::string name;
  int line = 0;  // of the paper's source; 0: ours
  ClaimTest test = ClaimTest::kCells;
  ClaimPairs pairs = ClaimPairs::kAll;
  bool is_equality = false;  // claimed to differ by at most the margin
  double margin = 0;         // points
  ClaimSide higher, lower;   // with equally many benchmarks
};

// kInvalidArgument names the claim and what is allowed; kUnknownName a benchmark or an algorithm.
Result<std::vector<Claim>> ReadClaims(const std::string& path,
                                      const std::vector<Benchmark>& benchmarks);

enum class Verdict { kSupported, kContradicted, kUndecided, kNotSettled, kNotRun };
std::string TextOf(Verdict verdict);

struct ClaimResult {
  Verdict verdict = Verdict::kNotRun;
  size_t comparisons = 0;  // or units, for "benchmarks", without those that the same runs fill
  size_t decided = 0;      // of them with scores that have settled
  size_t holding = 0;      // of the decided
  size_t unsettled = 0;    // with scores that have not settled
  std::set<std::string> lacking;  // algorithms without a score in one of the decided units
  double least_p = 0;             // of a claim about benchmarks, if all of them agreed
  // Of a claim about benchmarks: no verdict was possible with so many, beside so many other claims
  // of which none is decided.
  bool is_too_small = false;
  double p = 1;                // two-sided
  double adjusted_p = 1;       // by Holm, over all claims
  bool favours = false;        // whether the scores point in the claim's direction
  double least = 0, most = 0;  // of the decided differences, higher - lower
};

// In the order of the claims.
std::vector<ClaimResult> TestClaims(const std::vector<Claim>& claims, const CellScores& scores);

}  // namespace b4mrl

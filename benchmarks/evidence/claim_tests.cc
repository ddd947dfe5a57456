// How claims are tested (claims.h).
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "benchmarks/evidence/claims.h"
#include "benchmarks/statistics/significance.h"

namespace b4mrl {
namespace {

constexpr double kLevel = 0.05;

// Two cells of which the first is claimed to score higher.
struct Comparison {
  std::optional<CellScore> higher, lower;
  std::string algorithm;  // of the first

  bool IsThere() const { return higher && lower; }
  // Of one algorithm with itself: else a longer training, or another recipe, would count as what is
  // compared.
  void CompareAlike() {
    if (!IsThere()) return;
    if (auto alike = AtEqualUpdates(*higher, *lower)) {
      std::tie(higher, lower) = *std::move(alike);
    } else {
      lower.reset();
    }
  }
  bool IsSettled() const { return higher->settled && lower->settled; }
  double Difference() const { return higher->mean - lower->mean; }
};

// What is counted: a benchmark, or a pair of them, with all comparisons between the two.
struct Unit {
  std::vector<Comparison> comparisons;
  // That it holds if all algorithms are equally good: the best of six is better than the best of
  // two in six of eight cases.
  double chance = 0.5;
  std::set<std::string> lacking;  // see ClaimResult
};

std::optional<CellScore> ScoreIn(const CellScores& scores, const std::string& benchmark,
                                 const std::string& algorithm) {
  const CellScore* score = Find(scores, benchmark, algorithm);
  return score == nullptr ? std::nullopt : std::optional(*score);
}

// The best of those that have a score; the others are put into `lacking`. It has settled once all
// of them have, for another could still become the best.
std::optional<CellScore> BestOf(const CellScores& scores, const ClaimSide& side, size_t benchmark,
                                std::set<std::string>* lacking) {
  std::optional<CellScore> best;
  bool all_settled = true;
  for (const std::string& algorithm : side.algorithms) {
    const auto score = ScoreIn(scores, side.benchmarks[benchmark], algorithm);
    if (!score) {
      lacking->insert(algorithm);
      continue;
    }
    all_settled &= score->settled;
    if (!best || score->mean > best->mean) best = score;
  }
  if (best) best->settled = all_settled;
  return best;
}

Unit UnitOfBest(const Claim& claim, const CellScores& scores, size_t benchmark) {
  Unit unit;
  std::set<std::string> lacking_below;
  unit.comparisons = {{BestOf(scores, claim.higher, benchmark, &unit.lacking),
                       BestOf(scores, claim.lower, benchmark, &lacking_below)}};
  const size_t above = claim.higher.algorithms.size() - unit.lacking.size();
  const size_t below = claim.lower.algorithms.size() - lacking_below.size();
  unit.chance =
      static_cast<double>(above) / static_cast<double>(std::max<size_t>(above + below, 1));
  unit.lacking.merge(lacking_below);
  return unit;
}

// Algorithms that a claim names and that have no score in a unit. They are left out of it where the
// others' scores can decide: not if the claim is about all cells, and of the side that one
// algorithm has to beat as a whole none can be left out.
std::set<std::string> LackingIn(const Claim& claim, const CellScores& scores, size_t benchmark) {
  std::set<std::string> lacking;
  if (claim.test == ClaimTest::kCells) return lacking;
  for (const ClaimSide* side : {&claim.higher, &claim.lower}) {
    if (claim.test == ClaimTest::kAny && side == &claim.lower) continue;
    for (const std::string& algorithm : side->algorithms) {
      if (!ScoreIn(scores, side->benchmarks[benchmark], algorithm)) lacking.insert(algorithm);
    }
  }
  return lacking;
}

Unit UnitOf(const Claim& claim, const CellScores& scores, size_t benchmark) {
  if (claim.pairs == ClaimPairs::kBest) return UnitOfBest(claim, scores, benchmark);
  Unit unit;
  unit.lacking = LackingIn(claim, scores, benchmark);
  for (const std::string& one : claim.higher.algorithms) {
    for (const std::string& other : claim.lower.algorithms) {
      if (claim.pairs == ClaimPairs::kSame && one != other) continue;
      if (unit.lacking.contains(one) || unit.lacking.contains(other)) continue;
      unit.comparisons.push_back({ScoreIn(scores, claim.higher.benchmarks[benchmark], one),
                                  ScoreIn(scores, claim.lower.benchmarks[benchmark], other), one});
      if (one == other) unit.comparisons.back().CompareAlike();
    }
  }
  return unit;
}

// The one-sided P value: the probability that the measured difference of the two scores would be as
// large as it is, or larger, if the true difference were `truth`.
double ChanceAbove(const Comparison& comparison, double truth) {
  const double one = std::pow(comparison.higher->standard_error, 2);
  const double other = std::pow(comparison.lower->standard_error, 2);
  // Errors that are unknown, or that cannot be, decide nothing, in either direction.
  if (std::isinf(one + other) || one + other == 0) return 1;
  // Welch and Satterthwaite's degrees of freedom.
  const double degrees =
      (one + other) * (one + other) /
      (one * one / comparison.higher->degrees + other * other / comparison.lower->degrees);
  const double t = (comparison.Difference() - truth) / std::sqrt(one + other);
  const double two_sided = std::isinf(degrees) ? NormalTwoSided(t) : StudentTwoSided(t, degrees);
  return t > 0 ? two_sided / 2 : 1 - two_sided / 2;
}

double ChanceBelow(const Comparison& comparison, double truth) {
  return ChanceAbove({comparison.lower, comparison.higher}, -truth);
}

// One-sided probabilities of error of the claim and of its opposite.
struct Chances {
  double of_claim = 1, of_opposite = 1;
};

Chances ChancesOf(const Claim& claim, const Comparison& comparison) {
  if (!claim.is_equality) {
    return {ChanceAbove(comparison, claim.margin), ChanceBelow(comparison, claim.margin)};
  }
  // Two one-sided tests; the opposite is a difference beyond either margin.
  return {std::max(ChanceAbove(comparison, -claim.margin), ChanceBelow(comparison, claim.margin)),
          std::min(1.0, 2 * std::min(ChanceAbove(comparison, claim.margin),
                                     ChanceBelow(comparison, -claim.margin)))};
}

bool Holds(const Claim& claim, const Comparison& comparison) {
  const double difference = comparison.Difference();
  return claim.is_equality ? std::abs(difference) <= claim.margin : difference > claim.margin;
}

// Counts the differences of a comparison among those of the claim.
void CountDifference(const Comparison& comparison, ClaimResult* result) {
  const double difference = comparison.Difference();
  const bool is_first = result->least > result->most;
  result->least = is_first ? difference : std::min(result->least, difference);
  result->most = is_first ? difference : std::max(result->most, difference);
}

Chances TestCells(const Claim& claim, const std::vector<Unit>& units, ClaimResult* result) {
  Chances all = {0, 1};
  for (const Unit& unit : units) {
    for (const Comparison& comparison : unit.comparisons) {
      ++result->comparisons;
      if (!comparison.IsThere()) continue;
      if (!comparison.IsSettled()) {
        ++result->unsettled;
        continue;
      }
      ++result->decided;
      result->lacking.insert(unit.lacking.begin(), unit.lacking.end());
      result->holding += Holds(claim, comparison) ? 1 : 0;
      CountDifference(comparison, result);
      const Chances chances = ChancesOf(claim, comparison);
      all.of_claim = std::max(all.of_claim, chances.of_claim);
      all.of_opposite = std::min(all.of_opposite, chances.of_opposite);
    }
  }
  // One comparison that fails contradicts a claim about all; there were that many chances for it.
  all.of_opposite = std::min(1.0, all.of_opposite * static_cast<double>(result->decided));
  if (result->decided < result->comparisons) all.of_claim = 1;
  return all;
}

// Each algorithm of the upper side in each unit is a candidate, which has to beat the whole lower
// side. That no candidate does is no proof that none can.
Chances TestAny(const Claim& claim, const std::vector<Unit>& units, ClaimResult* result) {
  double least = 1;
  for (const Unit& unit : units) {
    std::map<std::string, std::vector<Comparison>> candidates;
    for (const Comparison& comparison : unit.comparisons) {
      candidates[comparison.algorithm].push_back(comparison);
    }
    for (const auto& [algorithm, comparisons] : candidates) {
      ++result->comparisons;
      if (!std::ranges::all_of(comparisons, &Comparison::IsThere)) continue;
      if (!std::ranges::all_of(comparisons, &Comparison::IsSettled)) {
        ++result->unsettled;
        continue;
      }
      ++result->decided;
      result->lacking.insert(unit.lacking.begin(), unit.lacking.end());
      const auto holds = [&](const Comparison& comparison) { return Holds(claim, comparison); };
      result->holding += std::ranges::all_of(comparisons, holds) ? 1 : 0;
      double all = 0;
      for (const Comparison& comparison : comparisons) {
        CountDifference(comparison, result);
        all = std::max(all, ChancesOf(claim, comparison).of_claim);
      }
      least = std::min(least, all);
    }
  }
  return {std::min(1.0, least * static_cast<double>(result->decided)), 1};
}

Chances TestUnits(const Claim& claim, const std::vector<Unit>& units, ClaimResult* result) {
  size_t failing = 0;
  std::vector<double> chances_of_claim;
  double all_hold = 1, none_holds = 1;
  for (const auto& [comparisons, chance, lacking] : units) {
    ++result->comparisons;
    // More than half is claimed, and what equally good algorithms would do proves nothing.
    const double least_chance = std::max(0.5, chance);
    all_hold *= least_chance;
    none_holds *= 0.5;
    if (comparisons.empty() || !std::ranges::all_of(comparisons, &Comparison::IsThere)) continue;
    if (!std::ranges::all_of(comparisons, &Comparison::IsSettled)) {
      ++result->unsettled;
      continue;
    }
    ++result->decided;
    result->lacking.insert(lacking.begin(), lacking.end());
    chances_of_claim.push_back(least_chance);
    const auto holds = [&](const Comparison& comparison) { return Holds(claim, comparison); };
    result->holding += std::ranges::all_of(comparisons, holds) ? 1 : 0;
    failing += std::ranges::none_of(comparisons, holds) ? 1 : 0;
    for (const Comparison& comparison : comparisons) CountDifference(comparison, result);
  }
  result->least_p = 2 * std::min(all_hold, none_holds);
  return {ChanceOfAtLeast(result->holding, chances_of_claim),
          ChanceOfAtLeast(failing, std::vector(result->decided, 0.5))};
}

// The claim's units, without those whose cells the same runs fill as those of an earlier unit.
std::vector<Unit> UnitsOf(const Claim& claim, const CellScores& scores) {
  std::vector<Unit> units;
  std::set<std::string> seen;
  for (size_t i = 0; i < claim.higher.benchmarks.size(); ++i) {
    Unit unit = UnitOf(claim, scores, i);
    std::string runs;
    for (const Comparison& comparison : unit.comparisons) {
      if (comparison.IsThere()) {
        runs += comparison.higher->runs + "," + comparison.lower->runs + ";";
      }
    }
    if (runs.empty() || seen.insert(runs).second) units.push_back(std::move(unit));
  }
  return units;
}

Chances TestOf(const Claim& claim, const std::vector<Unit>& units, ClaimResult* result) {
  switch (claim.test) {
    case ClaimTest::kBenchmarks:
      return TestUnits(claim, units, result);
    case ClaimTest::kCells:
      return TestCells(claim, units, result);
    case ClaimTest::kAny:
      return TestAny(claim, units, result);
  }
  return {};
}

ClaimResult TestClaim(const Claim& claim, const CellScores& scores) {
  ClaimResult result;
  result.least = 1;
  result.most = 0;  // no differences yet
  const std::vector<Unit> units = UnitsOf(claim, scores);
  const Chances chances = TestOf(claim, units, &result);
  result.favours = chances.of_claim <= chances.of_opposite;
  result.p = std::min(1.0, 2 * std::min(chances.of_claim, chances.of_opposite));
  if (result.decided > 0) {
    result.verdict = Verdict::kUndecided;
  } else {
    result.verdict = result.unsettled > 0 ? Verdict::kNotSettled : Verdict::kNotRun;
    result.least = result.most = 0;
  }
  return result;
}

}  // namespace

std::vector<ClaimResult> TestClaims(const std::vector<Claim>& claims, const CellScores& scores) {
  std::vector<ClaimResult> results;
  std::vector<double> p;  // of the claims that could be tested
  for (const Claim& claim : claims) {
    results.push_back(TestClaim(claim, scores));
    if (results.back().decided > 0) p.push_back(results.back().p);
  }
  const std::vector<double> adjusted = HolmAdjusted(p);
  size_t next = 0;
  for (ClaimResult& result : results) {
    if (result.decided == 0) continue;
    result.adjusted_p = adjusted[next++];
    result.is_too_small = result.least_p * static_cast<double>(p.size()) > kLevel;
    if (result.adjusted_p > kLevel) continue;
    result.verdict = result.favours ? Verdict::kSupported : Verdict::kContradicted;
  }
  return results;
}

}  // namespace b4mrl

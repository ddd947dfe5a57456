// The claims, tested on the paper's numbers and on ours.
#include <fmt/format.h>

#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {
namespace {

// "3 of 4 hold (of 7)".
std::string CountsEntry(const ClaimResult& result) {
  if (result.decided == 0) return kMissing;
  std::string text = fmt::format("{} of {}", result.holding, result.decided);
  if (result.decided < result.comparisons) text += fmt::format(" (of {})", result.comparisons);
  return text;
}

std::string RangeEntry(const ClaimResult& result) {
  if (result.decided == 0) return kMissing;
  if (result.least == result.most) return Signed(result.least);
  return fmt::format("{} to {}", Signed(result.least), Signed(result.most));
}

std::string VerdictEntry(const ClaimResult& result) {
  std::string text = TextOf(result.verdict);
  if (result.verdict == Verdict::kUndecided && result.is_too_small) text += ": too few benchmarks";
  const bool has_verdict = result.decided > 0 && !result.lacking.empty();
  if (has_verdict) text += fmt::format(" (without {})", fmt::join(result.lacking, ", "));
  return text;
}

std::string ChanceEntry(const ClaimResult& result) {
  // What is missing may fail: a claim of which some comparisons are missing has no p where those
  // that are there say nothing by themselves.
  const bool says_nothing = result.p >= 1 && result.decided < result.comparisons;
  if (result.decided == 0 || says_nothing) return kMissing;
  const auto shown = [](double p) { return p < 0.001 ? "<0.001" : fmt::format("{:.3f}", p); };
  return fmt::format("{} ({})", shown(result.p), shown(result.adjusted_p));
}

}  // namespace

Section ClaimsSection(const Evidence& evidence) {
  const auto paper = TestClaims(evidence.claims, evidence.paper);
  const auto ours = TestClaims(evidence.claims, evidence.ours);
  Section section;
  section.title = "Claims, tested";
  Table table;
  table.id = "claims";
  table.title = "What the paper says, and what we ask beside it.";
  table.caption =
      "The claims, though not all details of their tests, were written down before the suites' "
      "runs; what was known then, benchmarks/claims.toml says. Each claim is that one side scores "
      "higher than the other, but for the one about random data: that both are within 3 points. "
      "Algorithms differ in their updates (see the opening); one is compared with itself after "
      "equally many, or, where its longer run was not evaluated then, at its last evaluation "
      "before that. A claim about many benchmarks counts those in which it holds, and is tested by "
      "an exact sign test against chances of one half, or more where the best of many would be "
      "above the best of few by chance (6 in 8 for six beside two); a claim about cells must hold "
      "in each of them, by Welch's test; of one that says what can happen a single algorithm in a "
      "single benchmark must beat the whole other side, by Welch's tests corrected for all that "
      "could (Bonferroni). p is two-sided, and takes runs that several benchmarks share for "
      "independent ones; in brackets, adjusted by Holm's method over all claims of its column with "
      "a comparison of settled scores, where one without a p counts as 1; a verdict needs 0.05. "
      "Holds: in how many of the comparisons whose scores have settled (of how many there are); "
      "without: algorithms that they lack. Differences: the least and the greatest, in points, of "
      "the claimed direction. Too few benchmarks: even if all of the claim's pointed in one "
      "direction, beside so many undecided claims they would be no proof; more seeds would change "
      "nothing. So undecided says little against a claim; look at Holds. A claim of which some "
      "comparisons are missing has no p where the others would have one of 1. The paper's "
      "deviations seem to be divided by the number of its seeds, three: the error of a mean of its "
      "own is the deviation times 1.22 over the root of three, with two degrees of freedom. A cell "
      "of ours with fewer than three seeds borrows the deviation as it is printed, which would "
      "then be 1.22 times too small.";
  table.columns = {
      {"Line", true},     {"Claim"},   {"On the paper's numbers"}, {"Holds, paper", true},
      {"p, paper", true}, {"On ours"}, {"Holds, ours", true},      {"Differences", true},
      {"p, ours", true}};
  for (size_t i = 0; i < evidence.claims.size(); ++i) {
    const Claim& claim = evidence.claims[i];
    const bool is_theirs = paper[i].decided > 0;
    table.rows.push_back({claim.line > 0 ? fmt::format("{}", claim.line) : "ours", claim.name,
                          is_theirs ? VerdictEntry(paper[i]) : kMissing, CountsEntry(paper[i]),
                          ChanceEntry(paper[i]), VerdictEntry(ours[i]), CountsEntry(ours[i]),
                          RangeEntry(ours[i]), ChanceEntry(ours[i])});
  }
  section.blocks.emplace_back(std::move(table));
  return section;
}

}  // namespace b4mrl

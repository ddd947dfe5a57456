#include "benchmarks/evidence/claims.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "algorithms/list.h"
#include "benchmarks/plan/plan.h"
#include "data/files/toml_keys.h"

namespace b4mrl {
namespace {

using Texts = std::vector<std::string>;

constexpr std::string_view kHole = "{}";

// The number of the word among those that the key allows; the first one stands for "".
Result<size_t> Choose(std::string_view key, const std::string& word, const Texts& words) {
  if (word.empty()) return 0;
  const auto found = std::ranges::find(words, word);
  if (found != words.end()) return static_cast<size_t>(found - words.begin());
  return InvalidArgument(key, word, fmt::format("{}", fmt::join(words, ", ")));
}

// The names of a side, with {} replaced by each of `over`, and patterns by the names that fit them.
Result<Texts> SpellOut(const Texts& patterns, const Texts& over,
                       const std::vector<Benchmark>& benchmarks) {
  Texts spelled;
  for (const std::string& pattern : patterns) {
    const size_t hole = pattern.find(kHole);
    if (hole == std::string::npos) spelled.push_back(pattern);
    for (size_t i = 0; hole != std::string::npos && i < over.size(); ++i) {
      spelled.push_back(std::string(pattern).replace(hole, kHole.size(), over[i]));
    }
  }
  Texts known, names;
  for (const Benchmark& benchmark : benchmarks) known.push_back(benchmark.name);
  for (const std::string& each : spelled) {
    const size_t before = names.size();
    std::ranges::copy_if(known, std::back_inserter(names),
                         [&](const std::string& name) { return FitsPattern(name, each); });
    if (names.size() == before) return UnknownName("benchmark", each, known);
  }
  return names;
}

Result<ClaimSide> ReadSide(TomlKeys* claim, const std::string& key, const Texts& over,
                           const std::vector<Benchmark>& benchmarks) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table* table, claim->Table(key));
  if (table == nullptr) return InvalidArgument(key, "", "a table of algorithms and benchmarks");
  TomlKeys keys(*table, key);
  ClaimSide side;
  B4MRL_ASSIGN_OR_RETURN(side.algorithms, keys.Texts("algorithms"));
  for (const std::string& algorithm : side.algorithms) {
    B4MRL_RETURN_IF_ERROR(FindAlgorithm(algorithm).status());
  }
  B4MRL_ASSIGN_OR_RETURN(const Texts patterns, keys.Texts("benchmarks"));
  B4MRL_ASSIGN_OR_RETURN(side.benchmarks, SpellOut(patterns, over, benchmarks));
  B4MRL_RETURN_IF_ERROR(keys.Finish());
  return side;
}

Result<Claim> ReadClaim(const toml::table& table, const std::string& where,
                        const std::vector<Benchmark>& benchmarks) {
  TomlKeys keys(table, where);
  Claim claim;
  B4MRL_ASSIGN_OR_RETURN(claim.name, keys.Text("name", true));
  B4MRL_ASSIGN_OR_RETURN(const auto line, keys.Count("line"));
  claim.line = line.value_or(0);
  B4MRL_ASSIGN_OR_RETURN(const std::string test, keys.Text("test", true));
  B4MRL_ASSIGN_OR_RETURN(const size_t which, Choose("test", test, {"benchmarks", "cells", "any"}));
  claim.test = static_cast<ClaimTest>(which);
  B4MRL_ASSIGN_OR_RETURN(const std::string pairs, keys.Text("pairs"));
  B4MRL_ASSIGN_OR_RETURN(const size_t pairing, Choose("pairs", pairs, {"all", "same", "best"}));
  claim.pairs = static_cast<ClaimPairs>(pairing);
  B4MRL_ASSIGN_OR_RETURN(const std::string direction, keys.Text("direction"));
  B4MRL_ASSIGN_OR_RETURN(const size_t equal, Choose("direction", direction, {"higher", "equal"}));
  claim.is_equality = equal == 1;
  B4MRL_ASSIGN_OR_RETURN(const auto margin, keys.Count("margin"));
  claim.margin = static_cast<double>(margin.value_or(0));
  B4MRL_ASSIGN_OR_RETURN(const Texts over, keys.Texts("over"));
  B4MRL_ASSIGN_OR_RETURN(claim.higher, ReadSide(&keys, "higher", over, benchmarks));
  B4MRL_ASSIGN_OR_RETURN(claim.lower, ReadSide(&keys, "lower", over, benchmarks));
  B4MRL_RETURN_IF_ERROR(keys.Finish());
  if (claim.lower.benchmarks.empty()) claim.lower.benchmarks = claim.higher.benchmarks;
  if (claim.pairs == ClaimPairs::kSame) claim.lower.algorithms = claim.higher.algorithms;
  if (claim.higher.benchmarks.empty() ||
      claim.higher.benchmarks.size() != claim.lower.benchmarks.size()) {
    return InvalidNumber("benchmarks", static_cast<double>(claim.lower.benchmarks.size()),
                         fmt::format("as many below as above, {}", claim.higher.benchmarks.size()));
  }
  if (claim.higher.algorithms.empty() || claim.lower.algorithms.empty()) {
    return InvalidArgument("algorithms", "", "one or more on each side");
  }
  return claim;
}

}  // namespace

Result<std::vector<Claim>> ReadClaims(const std::string& path,
                                      const std::vector<Benchmark>& benchmarks) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table file, ReadTomlFile(path));
  TomlKeys keys(file, path);
  B4MRL_ASSIGN_OR_RETURN(const auto tables, keys.Tables("claim"));
  B4MRL_RETURN_IF_ERROR(keys.Finish());
  std::vector<Claim> claims;
  for (const toml::table* table : tables) {
    const std::string where = fmt::format("{}, claim {}", path, claims.size() + 1);
    auto claim = ReadClaim(*table, where, benchmarks);
    if (!claim.ok()) return claim.status().WithContext(where);
    claims.push_back(*std::move(claim));
  }
  return claims;
}

std::string TextOf(Verdict verdict) {
  switch (verdict) {
    case Verdict::kSupported:
      return "supported";
    case Verdict::kContradicted:
      return "contradicted";
    case Verdict::kUndecided:
      return "undecided";
    case Verdict::kNotSettled:
      return "not settled";
    case Verdict::kNotRun:
      return "not run";
  }
  return "";
}

}  // namespace b4mrl

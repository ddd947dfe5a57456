#include "benchmarks/evidence/agreement.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "algorithms/list.h"
#include "benchmarks/statistics/bootstrap.h"
#include "benchmarks/statistics/rank_correlation.h"
#include "proto/base/mean_and_std.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

constexpr size_t kDraws = 200;
constexpr size_t kResamples = 2000;
constexpr double kConfidence = 0.95;
constexpr size_t kLeastRanked = 3;  // algorithms in a benchmark, of which an order means something

// A cell of the paper's that is compared.
struct Item {
  const Benchmark* benchmark = nullptr;
  std::string algorithm;
  std::string run;            // see SharedRun
  std::string reference_run;  // what an effect is taken from; "": there is none
};

// Scores by the run that they are of (SharedRun).
using Table = std::map<std::string, double>;

// A number of the paper's and that of another table which belongs to it.
using Pair = std::pair<double, double>;

std::optional<double> SpearmanOf(const std::vector<Pair>& pairs) {
  std::vector<double> paper, other;
  for (const auto& [theirs, its] : pairs) {
    paper.push_back(theirs);
    other.push_back(its);
  }
  return Spearman(paper, other);
}

std::optional<double> MeanOf(const std::vector<double>& values) {
  if (values.empty()) return std::nullopt;
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

// The runs that one benchmark ranks.
using Ranking = std::set<std::string>;

// The rankings of the cells' benchmarks, without those whose runs another one ranks too: offline
// learners fill all benchmarks of a dataset, and each pair of runs is to count as one observation.
std::vector<Ranking> RankingsOf(const std::vector<Item>& cells) {
  std::map<const Benchmark*, Ranking> by_benchmark;
  for (const Item& item : cells) by_benchmark[item.benchmark].insert(item.run);
  std::set<Ranking> distinct;
  for (const auto& [benchmark, runs] : by_benchmark) {
    if (runs.size() >= kLeastRanked) distinct.insert(runs);
  }
  std::vector<Ranking> rankings;
  std::ranges::copy_if(distinct, std::back_inserter(rankings), [&](const Ranking& runs) {
    return std::ranges::none_of(distinct, [&](const Ranking& other) {
      return other.size() > runs.size() && std::ranges::includes(other, runs);
    });
  });
  return rankings;
}

bool IsOnline(const std::string& algorithm) {
  const auto known = FindAlgorithm(algorithm);
  return known.ok() && !(*known)->needs.dataset;
}

// All that the floor knows of a cell: the algorithm, and the dataset if it uses one.
std::string KnownToFloor(const Benchmark& benchmark, const std::string& algorithm) {
  return IsOnline(algorithm) ? algorithm : algorithm + " " + benchmark.dataset;
}

// The benchmark with the gravity error and, of this one, the dataset as recorded.
const Benchmark* ReferenceOf(const Benchmark& benchmark, const std::vector<Benchmark>& all) {
  const auto found = std::ranges::find_if(all, [&](const Benchmark& other) {
    return other.environment == benchmark.environment && other.challenge == "modelling-error" &&
           other.simulator == "gravity" && other.dataset == benchmark.dataset;
  });
  return found == all.end() ? nullptr : &*found;
}

class Comparer {
 public:
  Comparer(const CellScores& paper, const CellScores& ours,
           const std::vector<Benchmark>& benchmarks, const AgreementOptions& options);
  PaperAgreement Compare() const;

 private:
  // The paper's runs with other seeds.
  Table Draw(uint64_t draw) const;
  // What a figure is taken over: one value for each run, effect or ranking.
  std::vector<Pair> ScoresBeside(const Table& table) const;
  std::vector<Pair> EffectsBeside(const Table& table) const;
  std::vector<double> RankingsBeside(const Table& table) const;
  // Of the pairs that the paper separates.
  std::vector<double> SeparatedBeside(const Table& table) const;
  bool IsSeparated(const std::string& one, const std::string& other) const;
  std::vector<PairOrder> Pairs() const;
  // The figure that `summarise` makes of the values that `observe` returns for a table.
  template <typename Value>
  Agreement Figure(std::vector<Value> (Comparer::*observe)(const Table&) const,
                   std::optional<double> (*summarise)(const std::vector<Value>&)) const;

  std::vector<Item> runs_;     // the paper's that we have too
  std::vector<Item> effects_;  // of the runs, those with another one as reference
  std::vector<Ranking> rankings_;
  std::map<std::string, double> errors_;  // of the paper's means, by run
  // The pairs of runs that the paper separates, of each ranking that has any.
  std::vector<std::vector<std::pair<std::string, std::string>>> separated_;
  Table ours_, means_;
  std::map<std::string, double> deviations_;
  Table floor_;
};

Comparer::Comparer(const CellScores& paper, const CellScores& ours,
                   const std::vector<Benchmark>& benchmarks, const AgreementOptions& options) {
  std::map<std::string, std::vector<double>> known;  // by KnownToFloor
  std::set<std::string> seen;                        // runs of the paper
  std::vector<Item> cells;
  for (const Benchmark& benchmark : benchmarks) {
    for (const auto& [algorithm, unused] : benchmark.paper) {
      const CellScore& score = *Find(paper, benchmark.name, algorithm);
      if (benchmark.dataset.empty()) continue;
      if (seen.insert(SharedRun(benchmark, algorithm)).second) {
        known[KnownToFloor(benchmark, algorithm)].push_back(score.mean);
      }
      if (options.without.contains(algorithm)) continue;
      const CellScore* own = Find(ours, benchmark.name, algorithm);
      if (own == nullptr || (options.settled_only && !own->settled)) continue;
      Item item = {&benchmark, algorithm, SharedRun(benchmark, algorithm), ""};
      const Benchmark* reference = ReferenceOf(benchmark, benchmarks);
      if (reference != nullptr) item.reference_run = SharedRun(*reference, algorithm);
      if (ours_.emplace(item.run, own->mean).second) {
        means_[item.run] = score.mean;
        // Of one run from three: the paper's deviation is divided by the number of seeds.
        deviations_[item.run] = score.std * std::sqrt(1.5);
        errors_[item.run] = score.standard_error;
        runs_.push_back(item);
      }
      cells.push_back(std::move(item));
    }
  }
  rankings_ = RankingsOf(cells);
  for (const Ranking& runs : rankings_) {
    std::vector<std::pair<std::string, std::string>> pairs;
    for (auto one = runs.begin(); one != runs.end(); ++one) {
      for (auto other = std::next(one); other != runs.end(); ++other) {
        if (IsSeparated(*one, *other)) pairs.emplace_back(*one, *other);
      }
    }
    if (!pairs.empty()) separated_.push_back(std::move(pairs));
  }
  for (const Item& item : cells) {
    floor_[item.run] = MeanAndStdOf(known.at(KnownToFloor(*item.benchmark, item.algorithm))).mean;
  }
  for (const Item& item : runs_) {
    if (item.run != item.reference_run && ours_.contains(item.reference_run)) {
      effects_.push_back(item);
    }
  }
}

Table Comparer::Draw(uint64_t draw) const {
  Rng random(0, "another seed of the paper's", draw);
  Table table;
  for (const auto& [run, mean] : means_) table[run] = mean + deviations_.at(run) * random.Normal();
  return table;
}

std::vector<Pair> Comparer::ScoresBeside(const Table& table) const {
  std::vector<Pair> pairs;
  for (const Item& item : runs_) pairs.emplace_back(means_.at(item.run), table.at(item.run));
  return pairs;
}

std::vector<Pair> Comparer::EffectsBeside(const Table& table) const {
  std::vector<Pair> pairs;
  for (const Item& item : effects_) {
    pairs.emplace_back(means_.at(item.run) - means_.at(item.reference_run),
                       table.at(item.run) - table.at(item.reference_run));
  }
  return pairs;
}

std::vector<double> Comparer::RankingsBeside(const Table& table) const {
  std::vector<double> orders;
  for (const Ranking& runs : rankings_) {
    std::vector<double> paper, other;
    for (const std::string& run : runs) {
      paper.push_back(means_.at(run));
      other.push_back(table.at(run));
    }
    // A table that cannot tell the algorithms apart orders none of them.
    orders.push_back(Kendall(paper, other).value_or(0));
  }
  return orders;
}

bool Comparer::IsSeparated(const std::string& one, const std::string& other) const {
  return std::abs(means_.at(one) - means_.at(other)) >
         2 * std::hypot(errors_.at(one), errors_.at(other));
}

std::vector<double> Comparer::SeparatedBeside(const Table& table) const {
  std::vector<double> orders;
  for (const auto& pairs : separated_) {
    int order = 0;  // pairs that the table orders as the paper does, less the others
    for (const auto& [one, other] : pairs) {
      const double product =
          (means_.at(one) - means_.at(other)) * (table.at(one) - table.at(other));
      order += (product > 0) - (product < 0);
    }
    orders.push_back(order / static_cast<double>(pairs.size()));
  }
  return orders;
}

std::vector<PairOrder> Comparer::Pairs() const {
  std::map<std::string, std::string> algorithms;  // by run
  for (const Item& item : runs_) algorithms[item.run] = item.algorithm;
  const auto place = [&](const std::string& run) {
    return std::pair(OrderOf(algorithms.at(run)), run);
  };
  std::vector<PairOrder> pairs;
  std::set<std::pair<std::string, std::string>> seen;
  for (const Ranking& ranking : rankings_) {
    std::vector<std::string> runs(ranking.begin(), ranking.end());
    std::ranges::sort(runs, {}, place);
    for (size_t i = 0; i < runs.size(); ++i) {
      for (size_t j = i + 1; j < runs.size(); ++j) {
        const std::string &one = algorithms.at(runs[i]), &other = algorithms.at(runs[j]);
        auto pair = std::ranges::find_if(
            pairs, [&](const PairOrder& each) { return each.one == one && each.other == other; });
        if (pair == pairs.end()) pair = pairs.insert(pair, {one, other});
        const double ours = ours_.at(runs[i]) - ours_.at(runs[j]);
        const double theirs = means_.at(runs[i]) - means_.at(runs[j]);
        ++pair->rankings;
        const bool is_turned = ours * theirs < 0;
        pair->turned += is_turned ? 1 : 0;
        if (!seen.emplace(runs[i], runs[j]).second) continue;
        ++pair->runs;
        pair->turned_runs += is_turned ? 1 : 0;
      }
    }
  }
  std::ranges::stable_sort(pairs, {}, [](const PairOrder& pair) {
    return std::pair(OrderOf(pair.one), OrderOf(pair.other));
  });
  return pairs;
}

// Nothing where most resamples have no such figure.
template <typename Value>
std::optional<Interval> IntervalOf(const std::vector<Value>& values,
                                   std::optional<double> (*summarise)(const std::vector<Value>&)) {
  if (values.size() < 2) return std::nullopt;
  std::vector<std::vector<double>> estimates;
  std::vector<Value> drawn(values.size());
  for (uint64_t number = 0; number < kResamples; ++number) {
    Rng random(0, "resample of the agreement", number);
    for (Value& value : drawn) value = values[random.Below(values.size())];
    if (const auto each = summarise(drawn)) estimates.push_back({*each});
  }
  if (estimates.size() <= kResamples / 2) return std::nullopt;
  return PercentileIntervals(estimates, kConfidence).front();
}

template <typename Value>
Agreement Comparer::Figure(std::vector<Value> (Comparer::*observe)(const Table&) const,
                           std::optional<double> (*summarise)(const std::vector<Value>&)) const {
  const std::vector<Value> values = (this->*observe)(ours_);
  std::vector<double> draws;
  for (uint64_t draw = 0; draw < kDraws; ++draw) {
    if (const auto each = summarise((this->*observe)(Draw(draw)))) draws.push_back(*each);
  }
  return {.ours = summarise(values),
          .floor = summarise((this->*observe)(floor_)),
          .ceiling = draws.size() == kDraws ? MeanOf(draws) : std::nullopt,
          .interval = IntervalOf(values, summarise),
          .count = values.size()};
}

PaperAgreement Comparer::Compare() const {
  PaperAgreement agreement;
  agreement.scores = Figure(&Comparer::ScoresBeside, SpearmanOf);
  agreement.effects = Figure(&Comparer::EffectsBeside, SpearmanOf);
  // A table that does not know the flaw has effects that are all alike, and no order.
  if (agreement.effects.ours) agreement.effects.floor = 0;
  agreement.rankings = Figure(&Comparer::RankingsBeside, MeanOf);
  agreement.separated = Figure(&Comparer::SeparatedBeside, MeanOf);
  agreement.pairs = Pairs();
  return agreement;
}

}  // namespace

PaperAgreement AgreementWith(const CellScores& paper, const CellScores& ours,
                             const std::vector<Benchmark>& benchmarks,
                             const AgreementOptions& options) {
  return Comparer(paper, ours, benchmarks, options).Compare();
}

}  // namespace b4mrl

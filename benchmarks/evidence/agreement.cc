#include "benchmarks/evidence/agreement.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iterator>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "algorithms/list.h"
#include "benchmarks/statistics/grouped_bootstrap.h"
#include "benchmarks/statistics/rank_correlation.h"
#include "proto/base/mean_and_std.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

constexpr size_t kDraws = 200;
constexpr size_t kLeastRanked = 3;  // algorithms in a benchmark, of which an order means something

// A cell of the paper's that is compared.
struct Item {
  const Benchmark* benchmark = nullptr;
  std::string algorithm;
  std::string run;  // see SharedRun
};

// What a flaw changes: a run's score minus that of its reference.
struct Effect {
  std::string run, reference;
  double ours = 0;  // of runs with equally many updates
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

// The runs that one benchmark ranks, and the dataset and corruption of it (of the first of several
// that rank the same runs).
struct Ranking {
  std::set<std::string> runs;
  std::string data;
};

// Two runs of a ranking.
struct RunPair {
  std::string one, other, data;
};

// The rankings of the cells' benchmarks, without those whose runs another one ranks too: offline
// learners fill all benchmarks of a dataset, and each pair of runs is to count as one observation.
std::vector<Ranking> RankingsOf(const std::vector<Item>& cells) {
  std::map<const Benchmark*, Ranking> by_benchmark;
  for (const Item& item : cells) {
    Ranking& ranking = by_benchmark[item.benchmark];
    ranking.runs.insert(item.run);
    ranking.data = item.benchmark->dataset + " " + item.benchmark->corruption;
  }
  std::map<std::set<std::string>, std::string> distinct;  // data by runs
  for (const auto& [benchmark, ranking] : by_benchmark) {
    if (ranking.runs.size() >= kLeastRanked) distinct.emplace(ranking.runs, ranking.data);
  }
  std::vector<Ranking> rankings;
  for (const auto& [runs, data] : distinct) {
    const bool is_part = std::ranges::any_of(distinct, [&runs](const auto& other) {
      return other.first.size() > runs.size() && std::ranges::includes(other.first, runs);
    });
    if (!is_part) rankings.push_back({runs, data});
  }
  return rankings;
}

std::vector<RunPair> PairsIn(const Ranking& ranking) {
  std::vector<RunPair> pairs;
  for (auto one = ranking.runs.begin(); one != ranking.runs.end(); ++one) {
    for (auto other = std::next(one); other != ranking.runs.end(); ++other) {
      pairs.push_back({*one, *other, ranking.data});
    }
  }
  return pairs;
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
  // Means by the run that they are of, with their standard errors.
  struct Means {
    Table values, errors;
    // By more than two standard errors of the difference.
    bool AreApart(const RunPair& pair) const;
  };

  void AddRankings(const std::vector<Item>& cells);
  void AddEffects(const CellScores& ours, const std::vector<Benchmark>& benchmarks,
                  bool settled_only);
  // The paper's runs with other seeds.
  Table Draw(uint64_t draw) const;
  // What a figure is taken over: one value for each run, effect, ranking or pair.
  std::vector<Pair> ScoresBeside(const Table& table) const;
  std::vector<Pair> EffectsBeside(const Table& table) const;
  std::vector<double> RankingsBeside(const Table& table) const;
  std::vector<double> SeparatedBeside(const Table& table) const;
  std::vector<double> OrdersBeside(const Table& table, const std::vector<RunPair>& pairs) const;
  // 1 where the table orders the two as the paper does, -1 where otherwise, 0 where they are equal.
  int OrderIn(const Table& table, const RunPair& pair) const;
  std::vector<PairOrder> PairOrders() const;
  // The figure that `summarise` makes of our values, and of those that `observe` finds in another
  // table. Its interval resamples `groups`, to one of which each value belongs.
  template <typename Observe, typename Value>
  Agreement Figure(const std::vector<Value>& values, Observe observe,
                   std::optional<double> (*summarise)(const std::vector<Value>&),
                   const std::vector<std::string>& groups) const;

  std::vector<Item> runs_;       // the paper's that we have too
  std::vector<Effect> effects_;  // of the runs with another one as reference
  std::vector<Ranking> rankings_;
  std::vector<std::vector<RunPair>> separated_;  // by the paper, of each ranking that has any
  std::vector<RunPair> pairs_;                   // of all rankings, each once
  std::vector<RunPair> apart_;                   // of these, in the paper and in ours
  Means paper_, ours_;
  Table deviations_, floor_;
};

bool Comparer::Means::AreApart(const RunPair& pair) const {
  return std::abs(values.at(pair.one) - values.at(pair.other)) >
         2 * std::hypot(errors.at(pair.one), errors.at(pair.other));
}

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
      const CellScore* own = FindComparable(ours, benchmark.name, algorithm);
      if (own == nullptr || (options.settled_only && !own->settled)) continue;
      Item item = {&benchmark, algorithm, SharedRun(benchmark, algorithm)};
      if (ours_.values.emplace(item.run, own->mean).second) {
        ours_.errors[item.run] = own->standard_error;
        paper_.values[item.run] = score.mean;
        paper_.errors[item.run] = score.standard_error;
        // The paper's deviation of three seeds is divided by their number, so that of one run is
        // sqrt(3/2) times as large; and one run differs from their mean by the mean's own error,
        // too, which is sqrt(4/3) times as much.
        deviations_[item.run] = score.std * std::sqrt(2.0);
        runs_.push_back(item);
      }
      cells.push_back(std::move(item));
    }
  }
  AddRankings(cells);
  for (const Item& item : cells) {
    floor_[item.run] = MeanAndStdOf(known.at(KnownToFloor(*item.benchmark, item.algorithm))).mean;
  }
  AddEffects(ours, benchmarks, options.settled_only);
}

void Comparer::AddEffects(const CellScores& ours, const std::vector<Benchmark>& benchmarks,
                          bool settled_only) {
  const auto own = [&](const Item& item) -> const CellScore& {
    return *Find(ours, item.benchmark->name, item.algorithm);
  };
  for (const Item& item : runs_) {
    const Benchmark* benchmark = ReferenceOf(*item.benchmark, benchmarks);
    if (benchmark == nullptr) continue;
    const std::string run = SharedRun(*benchmark, item.algorithm);
    const auto reference = std::ranges::find(runs_, run, &Item::run);
    if (run == item.run || reference == runs_.end()) continue;
    const auto alike = AtEqualUpdates(own(item), own(*reference));
    if (!alike) continue;
    const auto& [flawed, clean] = *alike;
    if (settled_only && !(flawed.settled && clean.settled)) continue;
    effects_.push_back({item.run, run, flawed.mean - clean.mean});
  }
}

void Comparer::AddRankings(const std::vector<Item>& cells) {
  rankings_ = RankingsOf(cells);
  std::set<std::pair<std::string, std::string>> seen;
  for (const Ranking& ranking : rankings_) {
    std::vector<RunPair> separated;
    for (const RunPair& pair : PairsIn(ranking)) {
      const bool is_separated = paper_.AreApart(pair);
      if (is_separated) separated.push_back(pair);
      if (!seen.emplace(pair.one, pair.other).second) continue;
      pairs_.push_back(pair);
      if (is_separated && ours_.AreApart(pair)) apart_.push_back(pair);
    }
    if (!separated.empty()) separated_.push_back(std::move(separated));
  }
}

Table Comparer::Draw(uint64_t draw) const {
  Rng random(0, "another seed of the paper's", draw);
  Table table;
  for (const auto& [run, mean] : paper_.values)
    table[run] = mean + deviations_.at(run) * random.Normal();
  return table;
}

std::vector<Pair> Comparer::ScoresBeside(const Table& table) const {
  std::vector<Pair> pairs;
  for (const Item& item : runs_) pairs.emplace_back(paper_.values.at(item.run), table.at(item.run));
  return pairs;
}

std::vector<Pair> Comparer::EffectsBeside(const Table& table) const {
  std::vector<Pair> pairs;
  for (const Effect& effect : effects_) {
    pairs.emplace_back(paper_.values.at(effect.run) - paper_.values.at(effect.reference),
                       table.at(effect.run) - table.at(effect.reference));
  }
  return pairs;
}

std::vector<double> Comparer::RankingsBeside(const Table& table) const {
  std::vector<double> orders;
  for (const Ranking& ranking : rankings_) {
    std::vector<double> paper, other;
    for (const std::string& run : ranking.runs) {
      paper.push_back(paper_.values.at(run));
      other.push_back(table.at(run));
    }
    // A table that cannot tell the algorithms apart orders none of them.
    orders.push_back(Kendall(paper, other).value_or(0));
  }
  return orders;
}

int Comparer::OrderIn(const Table& table, const RunPair& pair) const {
  const double product = (paper_.values.at(pair.one) - paper_.values.at(pair.other)) *
                         (table.at(pair.one) - table.at(pair.other));
  return (product > 0) - (product < 0);
}

std::vector<double> Comparer::OrdersBeside(const Table& table,
                                           const std::vector<RunPair>& pairs) const {
  std::vector<double> orders;
  for (const RunPair& pair : pairs) orders.push_back(OrderIn(table, pair));
  return orders;
}

std::vector<double> Comparer::SeparatedBeside(const Table& table) const {
  std::vector<double> means;
  for (const auto& pairs : separated_) means.push_back(*MeanOf(OrdersBeside(table, pairs)));
  return means;
}

std::vector<PairOrder> Comparer::PairOrders() const {
  std::map<std::string, std::string> algorithms;  // by run
  for (const Item& item : runs_) algorithms[item.run] = item.algorithm;
  std::vector<PairOrder> orders;
  const auto order_of = [&](const RunPair& pair) -> PairOrder& {
    std::string one = algorithms.at(pair.one), other = algorithms.at(pair.other);
    if (OrderOf(other) < OrderOf(one)) std::swap(one, other);
    const auto found = std::ranges::find_if(
        orders, [&](const PairOrder& each) { return each.one == one && each.other == other; });
    return found == orders.end() ? *orders.insert(found, {one, other}) : *found;
  };
  const auto is_reversed = [this](const RunPair& pair) { return OrderIn(ours_.values, pair) < 0; };
  for (const Ranking& ranking : rankings_) {
    for (const RunPair& pair : PairsIn(ranking)) {
      PairOrder& order = order_of(pair);
      ++order.rankings;
      order.reversed += is_reversed(pair) ? 1 : 0;
    }
  }
  for (const RunPair& pair : pairs_) {
    PairOrder& order = order_of(pair);
    const size_t reversed = is_reversed(pair) ? 1 : 0;
    ++order.runs;
    order.reversed_runs += reversed;
    if (!paper_.AreApart(pair)) continue;
    ++order.separated;
    order.reversed_separated += reversed;
    if (!ours_.AreApart(pair)) continue;
    ++order.apart;
    order.reversed_apart += reversed;
  }
  std::ranges::stable_sort(orders, {}, [](const PairOrder& order) {
    return std::pair(OrderOf(order.one), OrderOf(order.other));
  });
  return orders;
}

template <typename Observe, typename Value>
Agreement Comparer::Figure(const std::vector<Value>& values, Observe observe,
                           std::optional<double> (*summarise)(const std::vector<Value>&),
                           const std::vector<std::string>& groups) const {
  std::vector<double> draws;
  for (uint64_t draw = 0; draw < kDraws; ++draw) {
    if (const auto each = summarise(observe(Draw(draw)))) draws.push_back(*each);
  }
  return {.ours = summarise(values),
          .floor = summarise(observe(floor_)),
          .ceiling = draws.size() == kDraws ? MeanOf(draws) : std::nullopt,
          .interval = IntervalOverGroups(values, summarise, groups),
          .count = values.size()};
}

// What each thing belongs to that a figure counts.
template <typename Thing, typename GroupOf>
std::vector<std::string> GroupsOf(const std::vector<Thing>& things, GroupOf group_of) {
  std::vector<std::string> groups;
  for (const Thing& thing : things) groups.push_back(std::invoke(group_of, thing));
  return groups;
}

PaperAgreement Comparer::Compare() const {
  PaperAgreement agreement;
  const Table& ours = ours_.values;
  const auto scores = [this](const Table& table) { return ScoresBeside(table); };
  agreement.scores = Figure(scores(ours), scores, SpearmanOf, GroupsOf(runs_, &Item::run));
  const auto effects = [this](const Table& table) { return EffectsBeside(table); };
  std::vector<Pair> own = EffectsBeside(ours);
  for (size_t i = 0; i < own.size(); ++i) own[i].second = effects_[i].ours;
  agreement.effects = Figure(own, effects, SpearmanOf, GroupsOf(effects_, &Effect::run));
  // A table that does not know the flaw has effects that are all alike, and no order.
  if (agreement.effects.ours) agreement.effects.floor = 0;
  const auto rankings = [this](const Table& table) { return RankingsBeside(table); };
  agreement.rankings =
      Figure(rankings(ours), rankings, MeanOf, GroupsOf(rankings_, &Ranking::data));
  const auto separated = [this](const Table& table) { return SeparatedBeside(table); };
  agreement.separated = Figure(
      separated(ours), separated, MeanOf,
      GroupsOf(separated_, [](const std::vector<RunPair>& pairs) { return pairs.front().data; }));
  const auto run_pairs = [this](const Table& table) { return OrdersBeside(table, pairs_); };
  agreement.run_pairs =
      Figure(run_pairs(ours), run_pairs, MeanOf, GroupsOf(pairs_, &RunPair::data));
  const auto apart = [this](const Table& table) { return OrdersBeside(table, apart_); };
  agreement.apart = Figure(apart(ours), apart, MeanOf, GroupsOf(apart_, &RunPair::data));
  agreement.pairs = PairOrders();
  return agreement;
}

}  // namespace

PaperAgreement AgreementWith(const CellScores& paper, const CellScores& ours,
                             const std::vector<Benchmark>& benchmarks,
                             const AgreementOptions& options) {
  return Comparer(paper, ours, benchmarks, options).Compare();
}

}  // namespace b4mrl

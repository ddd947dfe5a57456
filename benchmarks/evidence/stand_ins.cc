#include "benchmarks/evidence/stand_ins.h"

#include <map>
#include <string>

namespace b4mrl {

CellScores WithStandIn(const CellScores& ours, const std::vector<Benchmark>& benchmarks,
                       const StandIn& stand_in) {
  std::map<std::string, const CellScore*> found;  // by the run (SharedRun)
  for (const Benchmark& benchmark : benchmarks) {
    if (benchmark.dataset != stand_in.by) continue;
    for (auto cell = ours.lower_bound({benchmark.name, ""});
         cell != ours.end() && cell->first.first == benchmark.name; ++cell) {
      found.emplace(SharedRun(benchmark, cell->first.second), &cell->second);
    }
  }
  CellScores scores = ours;
  for (const Benchmark& benchmark : benchmarks) {
    if (benchmark.dataset != stand_in.dataset) continue;
    Benchmark on_other = benchmark;
    on_other.dataset = stand_in.by;
    for (const auto& [algorithm, unused] : benchmark.paper) {
      const std::string run = SharedRun(on_other, algorithm);
      if (run == SharedRun(benchmark, algorithm)) continue;  // it uses no dataset
      scores.erase({benchmark.name, algorithm});
      const auto other = found.find(run);
      if (other != found.end()) scores[{benchmark.name, algorithm}] = *other->second;
    }
  }
  return scores;
}

}  // namespace b4mrl

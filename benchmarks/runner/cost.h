// What training costs: seconds of one core, learned from the results that there are.
//
// Value type; any thread.
#pragma once

#include <map>
#include <string>

#include "benchmarks/plan/plan.h"
#include "benchmarks/records/result_file.h"

namespace b4mrl {

class CostModel {
 public:
  // Takes in what a run's result says of its seconds.
  void Learn(const PlannedRun& run, const RunResult& result);
  // Seconds of `updates` updates of a run: what those of its algorithm, recipe and precision took;
  // without any, what they take on a core of 2024 that has the machine for itself.
  double SecondsOf(const PlannedRun& run, double updates) const;

 private:
  struct Sum {
    double seconds = 0;
    double updates = 0;
  };
  std::map<std::string, Sum> learned_;  // by environment, algorithm, recipe and precision
};

}  // namespace b4mrl

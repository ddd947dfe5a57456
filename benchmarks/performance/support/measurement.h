// The reports of `b4mrl-perf`: a measured figure beside a limit that was measured in the same run.
//
// Noise of a shared machine moves slowly, so a value and its limit are measured in turns
// (MeasureInTurns), and the medians of the turns are compared. One thread.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl::perf {

struct Measurement {
  std::string name;  // "step-HalfCheetah"
  double value = 0;
  std::string unit;  // "1/s" or "us"
  double limit = 0;
  std::string limit_name;
  double target = 0;       // value / limit to reach; 0: no target
  bool smaller_is_better;  // whether a smaller value / limit is better

  double ratio() const { return value / limit; }
};

double Median(std::vector<double> values);

// Calls `value` and `limit` alternately, `turns` times each after one warm-up call each, and
// returns the medians. The first error ends the measurement, as does an interrupt
// (client/interrupt.h).
struct Medians {
  double value = 0;
  double limit = 0;
};
using Sampler = std::function<Result<double>()>;
Result<Medians> MeasureInTurns(int turns, const Sampler& value, const Sampler& limit);

// Processor and number of cores: "AMD EPYC, 2 cores".
std::string MachineName();

// Writes measurements to stdout as they come: JSON lines, or a table for people.
class Reporter {
 public:
  explicit Reporter(bool json) : json_(json), machine_(MachineName()) {}
  void Report(const Measurement& measurement);

 private:
  bool json_;
  std::string machine_;
  bool header_printed_ = false;
};

}  // namespace b4mrl::perf

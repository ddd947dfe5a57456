// What `b4mrl-perf` reports: a measured figure beside a limit that was measured in the same run.
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
  double target = 0;       // the ratio to reach; 0: none was set
  bool smaller_is_better;  // of value / limit

  double ratio() const { return value / limit; }
  bool reaches_target() const {
    return target == 0 || (smaller_is_better ? ratio() <= target : ratio() >= target);
  }
};

double Median(std::vector<double> values);

// The medians of `turns` results each of `value` and `limit`, called alternately after one call of
// each that only warms up. The first error ends it, and so does an interrupt (client/interrupt.h).
struct Medians {
  double value = 0;
  double limit = 0;
};
using Sampler = std::function<Result<double>()>;
Result<Medians> MeasureInTurns(int turns, const Sampler& value, const Sampler& limit);

// "AMD EPYC, 2 cores"
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

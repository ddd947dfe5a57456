#include "benchmarks/performance/support/measurement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "client/interrupt.h"
#include "proto/base/cores.h"

namespace b4mrl::perf {

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const size_t middle = values.size() / 2;
  return values.size() % 2 == 1 ? values[middle] : (values[middle - 1] + values[middle]) / 2;
}

Result<Medians> MeasureInTurns(int turns, const Sampler& value, const Sampler& limit) {
  std::vector<double> values;
  std::vector<double> limits;
  for (int turn = -1; turn < turns; ++turn) {
    B4MRL_ASSIGN_OR_RETURN(const double one_value, value());
    if (Interrupted()) return Status(StatusCode::kUnavailable, "interrupted");
    B4MRL_ASSIGN_OR_RETURN(const double one_limit, limit());
    if (Interrupted()) return Status(StatusCode::kUnavailable, "interrupted");
    if (turn < 0) continue;
    values.push_back(one_value);
    limits.push_back(one_limit);
  }
  return Medians{Median(std::move(values)), Median(std::move(limits))};
}

std::string MachineName() {
  const size_t cores = AvailableCores().size();
  return fmt::format("{}, {} core{}", ProcessorName(), cores, cores == 1 ? "" : "s");
}

void Reporter::Report(const Measurement& m) {
  if (json_) {
    const nlohmann::ordered_json line = {
        {"name", m.name},     {"value", m.value},           {"unit", m.unit},
        {"limit", m.limit},   {"limit_name", m.limit_name}, {"ratio", m.ratio()},
        {"machine", machine_}};
    fmt::print("{}\n", line.dump());
  } else {
    if (!header_printed_) {
      fmt::print("{}\n\n{:<20} {:>12} {:>12} {:<4} {:>6} {:>8}  {}\n", machine_, "measure", "value",
                 "limit", "unit", "ratio", "target", "limit is");
      header_printed_ = true;
    }
    std::string target = "-";
    if (m.target > 0)
      target = fmt::format("{} {:.2f}", m.smaller_is_better ? "<=" : ">=", m.target);
    fmt::print("{:<20} {:>12.1f} {:>12.1f} {:<4} {:>6.2f} {:>8}  {}\n", m.name, m.value, m.limit,
               m.unit, m.ratio(), target, m.limit_name);
  }
  std::fflush(stdout);
}

}  // namespace b4mrl::perf

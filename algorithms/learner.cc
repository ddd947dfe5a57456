#include "algorithms/learner.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace b4mrl {

Status Hyperparameters::Set(std::string_view name, double value) {
  std::vector<std::string_view> names;
  for (Hyperparameter& entry : entries_) {
    names.push_back(entry.name);
    if (entry.name != name) continue;
    const bool fits = value >= entry.low && value <= entry.high;  // false for NaN
    if (!fits || (entry.whole && value != std::floor(value))) {
      return InvalidNumber(
          name, value,
          fmt::format("{}{}..{}", entry.whole ? "a whole number in " : "", entry.low, entry.high));
    }
    entry.value = value;
    return Status();
  }
  return UnknownName("hyperparameter", name, names);
}

double Hyperparameters::Number(std::string_view name) const {
  const auto entry = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Hyperparameter& e) { return e.name == name; });
  return entry == entries_.end() ? std::nan("") : entry->value;
}

std::vector<float> LearnerContext::ActionScale() const {
  std::vector<float> scale;
  for (const DimensionSpec& dimension : environment.action.dimensions) {
    scale.push_back(static_cast<float>(dimension.high));
  }
  return scale;
}

}  // namespace b4mrl

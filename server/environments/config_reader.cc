#include "server/environments/config_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace b4mrl {

const Config* ConfigReader::Find(const std::string& key) {
  const auto it = config_.find(key);
  return it == config_.end() ? nullptr : &*it;
}

void ConfigReader::Fail(Status status) {
  if (first_error_.ok()) first_error_ = std::move(status);
}

double ConfigReader::Number(const std::string& key, double fallback, double low, double high) {
  double value = fallback;
  if (const Config* found = Find(key)) {
    const double given = found->is_number() ? found->get<double>() : std::nan("");
    if (given >= low && given <= high) {
      value = given;
    } else {
      Fail(InvalidArgument(key, found->dump(), fmt::format("a number in {}..{}", low, high)));
    }
  }
  completed_[key] = value;
  return value;
}

uint64_t ConfigReader::Integer(const std::string& key, uint64_t fallback, uint64_t low,
                               uint64_t high) {
  uint64_t value = fallback;
  if (const Config* found = Find(key)) {
    const bool fits =
        found->is_number_unsigned() || (found->is_number_integer() && found->get<int64_t>() >= 0);
    const uint64_t given = fits ? found->get<uint64_t>() : 0;
    if (fits && given >= low && given <= high) {
      value = given;
    } else {
      Fail(InvalidArgument(key, found->dump(), fmt::format("an integer in {}..{}", low, high)));
    }
  }
  completed_[key] = value;
  return value;
}

bool ConfigReader::Bool(const std::string& key, bool fallback) {
  bool value = fallback;
  if (const Config* found = Find(key)) {
    if (found->is_boolean()) {
      value = found->get<bool>();
    } else {
      Fail(InvalidArgument(key, found->dump(), "true or false"));
    }
  }
  completed_[key] = value;
  return value;
}

Interval ConfigReader::Range(const std::string& key, Interval fallback, RangeEnds ends) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const bool may_be_open = ends == RangeEnds::kMayBeOpen;
  Interval range = fallback;
  if (const Config* found = Find(key)) {
    const auto end = [&](size_t i, double open) {
      const Config& value = (*found)[i];
      if (value.is_null() && may_be_open) return open;
      return value.is_number() ? value.get<double>() : std::nan("");
    };
    const bool is_pair = found->is_array() && found->size() == 2;
    const Interval given = is_pair ? Interval{end(0, -kInfinity), end(1, kInfinity)} : Interval{};
    if (given.low < given.high) {
      range = given;
    } else {
      Fail(InvalidArgument(key, found->dump(),
                           may_be_open ? "[low, high] with low < high; null: no bound"
                                       : "[low, high], two numbers with low < high"));
    }
  }
  const auto as_json = [](double x) { return std::isinf(x) ? Config() : Config(x); };
  completed_[key] = {as_json(range.low), as_json(range.high)};
  return range;
}

std::string ConfigReader::Choice(const std::string& key, const std::vector<std::string>& allowed) {
  std::string value = allowed.front();
  if (const Config* found = Find(key)) {
    const std::string given = found->is_string() ? found->get<std::string>() : "";
    if (std::ranges::find(allowed, given) != allowed.end()) {
      value = given;
    } else {
      Fail(InvalidArgument(key, found->dump(), fmt::format("one of {}", fmt::join(allowed, ", "))));
    }
  }
  completed_[key] = value;
  return value;
}

Status ConfigReader::Finish() const {
  if (!first_error_.ok()) return first_error_;
  for (const auto& [key, value] : config_.items()) {
    if (completed_.contains(key)) continue;
    std::vector<std::string> known;
    for (const auto& [name, unused] : completed_.items()) known.push_back(name);
    return UnknownName("setting", key, known);
  }
  return Status();
}

}  // namespace b4mrl

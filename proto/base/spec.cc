#include "proto/base/spec.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>

namespace b4mrl {
namespace {

// `text` without the spaces at both ends.
std::string_view Trimmed(std::string_view text) {
  const size_t first = std::min(text.find_first_not_of(' '), text.size());
  return text.substr(first, text.find_last_not_of(' ') + 1 - first);
}

// Every name that a list of dimensions may have, features first.
std::vector<std::string> NamesAndFeatures(const std::vector<DimensionSpec>& dimensions) {
  std::set<std::string> features;
  for (const DimensionSpec& dimension : dimensions) {
    if (!dimension.feature.empty()) features.insert(dimension.feature);
  }
  std::vector<std::string> names(features.begin(), features.end());
  for (const DimensionSpec& dimension : dimensions) names.push_back(dimension.name);
  return names;
}

}  // namespace

Result<uint32_t> SpaceSpec::FindDimension(std::string_view index_or_name) const {
  for (size_t i = 0; i < dimensions.size(); ++i) {
    if (dimensions[i].name == index_or_name) return static_cast<uint32_t>(i);
  }
  const bool is_number =
      !index_or_name.empty() && std::all_of(index_or_name.begin(), index_or_name.end(),
                                            [](char c) { return c >= '0' && c <= '9'; });
  if (!is_number || dimensions.empty()) {
    return UnknownName("dimension", index_or_name, NamesAndFeatures(dimensions));
  }
  B4MRL_ASSIGN_OR_RETURN(const uint64_t index,
                         ParseUnsigned("dimension", index_or_name, 0, dimensions.size() - 1));
  return static_cast<uint32_t>(index);
}

Result<std::vector<uint32_t>> SpaceSpec::FindDimensions(
    std::string_view index_name_or_feature) const {
  std::vector<uint32_t> found;
  for (size_t i = 0; i < dimensions.size() && !index_name_or_feature.empty(); ++i) {
    if (dimensions[i].feature == index_name_or_feature) found.push_back(static_cast<uint32_t>(i));
  }
  if (!found.empty()) return found;
  B4MRL_ASSIGN_OR_RETURN(const uint32_t dimension, FindDimension(index_name_or_feature));
  return std::vector<uint32_t>{dimension};
}

Result<std::vector<uint32_t>> SpaceSpec::ParseDimensions(std::string_view list) const {
  std::set<uint32_t> parsed;
  // Each entry is looked for among all dimensions, and a peer's list may repeat one thousands of
  // times.
  std::set<std::string_view> looked_for;
  while (true) {
    const size_t end = std::min(list.find('+'), list.size());
    const std::string_view entry = list.substr(0, end);
    if (looked_for.insert(entry).second) {
      B4MRL_ASSIGN_OR_RETURN(const std::vector<uint32_t> named, FindDimensions(entry));
      parsed.insert(named.begin(), named.end());
    }
    if (end == list.size()) return std::vector<uint32_t>(parsed.begin(), parsed.end());
    list.remove_prefix(end + 1);
  }
}

std::optional<double> EnvironmentSpec::NormalisedScore(double episode_return) const {
  if (!reference_min || !reference_max) return std::nullopt;
  return 100.0 * (episode_return - *reference_min) / (*reference_max - *reference_min);
}

std::vector<float> EnvironmentSpec::ActionScale() const {
  std::vector<float> scale;
  for (const DimensionSpec& dimension : action.dimensions) {
    scale.push_back(static_cast<float>(dimension.high));
  }
  return scale;
}

Status EnvironmentSpec::CheckActionScale() const {
  for (const DimensionSpec& dimension : action.dimensions) {
    if (dimension.high > 0 && std::isfinite(dimension.high) && dimension.low == -dimension.high) {
      continue;
    }
    return Status(StatusCode::kUnsupported,
                  fmt::format("action '{}' of {} lies in {}..{}, allowed: -x..x", dimension.name,
                              name, dimension.low, dimension.high));
  }
  return Status();
}

Status EnvironmentSpec::CheckSizes(std::string_view owner, uint64_t observation_size,
                                   uint64_t action_size) const {
  if (observation_size == observation.size() && action_size == action.size()) return Status();
  return Status(
      StatusCode::kInvalidArgument,
      fmt::format("{} has {} observation and {} action values, {} has {} and {}", owner,
                  observation_size, action_size, name, observation.size(), action.size()));
}

Result<std::vector<NamedArgument>> ParseNamedArguments(std::string_view text) {
  std::vector<NamedArgument> items;
  if (text.empty()) return items;
  while (true) {
    const size_t comma = text.find(',');
    const std::string_view item = Trimmed(text.substr(0, comma));
    const size_t equals = item.find('=');
    const std::string_view name = Trimmed(item.substr(0, equals));
    const bool valid_name = !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
    });
    const bool has_argument = equals != std::string_view::npos;
    const std::string_view argument = has_argument ? Trimmed(item.substr(equals + 1)) : "";
    if (!valid_name || (has_argument && argument.empty())) {
      return InvalidArgument("perturbation", item, "name or name=argument, separated by commas");
    }
    items.push_back({std::string(name), std::string(argument)});
    if (comma == std::string_view::npos) return items;
    text.remove_prefix(comma + 1);
  }
}

std::string FormatNamedArguments(const std::vector<NamedArgument>& items) {
  std::string text;
  for (const NamedArgument& item : items) {
    if (!text.empty()) text += ',';
    text += item.ToString();
  }
  return text;
}

Result<double> ParseFinite(std::string_view name, std::string_view text, double low, double high) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  if (!whole || !std::isfinite(value) || value < low || value > high) {
    return InvalidArgument(name, text, fmt::format("a number in {}..{}", low, high));
  }
  return value;
}

Result<uint64_t> ParseUnsigned(std::string_view name, std::string_view text, uint64_t low,
                               uint64_t high) {
  uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  if (!whole || value < low || value > high) {
    return InvalidArgument(name, text, fmt::format("a whole number in {}..{}", low, high));
  }
  return value;
}

}  // namespace b4mrl

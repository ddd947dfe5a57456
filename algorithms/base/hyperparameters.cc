#include "algorithms/base/hyperparameters.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "proto/base/spec.h"

namespace b4mrl {
namespace {

[[noreturn]] void Abort(const std::string& error) {
  fmt::print(stderr, "b4mrl: {}\n", error);
  std::abort();
}

}  // namespace

std::vector<std::string_view> Hyperparameter::ChoiceNames() const {
  std::vector<std::string_view> names;
  for (std::string_view rest = choices; !rest.empty();) {
    const size_t end = std::min(rest.find('|'), rest.size());
    names.push_back(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return names;
}

std::string Hyperparameter::TextOf(double any) const {
  if (choices.empty()) return fmt::format("{}", any);
  return std::string(ChoiceNames()[static_cast<size_t>(any)]);
}

Hyperparameter Real(std::string_view name, double value, Range range, std::string_view meaning,
                    const RowDetails& details) {
  return {name,    value,        range.low,      range.high, false,
          meaning, details.unit, details.source, {},         details.by_environment};
}

Hyperparameter Whole(std::string_view name, double value, Range range, std::string_view meaning,
                     const RowDetails& details) {
  Hyperparameter row = Real(name, value, range, meaning, details);
  row.whole = true;
  return row;
}

Hyperparameter Switch(std::string_view name, bool value, std::string_view meaning,
                      std::string_view source) {
  return Choice(name, "false|true", value ? 1 : 0, meaning, source);
}

Hyperparameter Choice(std::string_view name, std::string_view choices, int value,
                      std::string_view meaning, std::string_view source) {
  const auto last = static_cast<double>(std::count(choices.begin(), choices.end(), '|'));
  Hyperparameter row = Whole(name, value, {0, last}, meaning, {.source = source});
  row.choices = choices;
  return row;
}

Hyperparameter WithoutEffect(Hyperparameter row) {
  row.is_without_effect = true;
  return row;
}

HyperparameterTable operator+(HyperparameterTable table, const HyperparameterTable& more) {
  table.insert(table.end(), more.begin(), more.end());
  return table;
}

Hyperparameters::Hyperparameters(std::span<const Hyperparameter> table,
                                 std::string_view environment)
    : entries_(table.begin(), table.end()) {
  for (Hyperparameter& entry : entries_) {
    for (const EnvironmentDefault& other : entry.by_environment) {
      if (other.environment == environment) entry.value = other.value;
    }
  }
}

Status Hyperparameters::Set(std::string_view name, double value) {
  B4MRL_ASSIGN_OR_RETURN(Hyperparameter * entry, Need(name));
  const bool fits = value >= entry->low && value <= entry->high;  // false for NaN
  if (!fits || (entry->whole && value != std::floor(value))) {
    return InvalidNumber(
        name, value,
        fmt::format("{}{}..{}", entry->whole ? "a whole number in " : "", entry->low, entry->high));
  }
  entry->value = value;
  return Status();
}

Status Hyperparameters::SetText(std::string_view name, std::string_view text) {
  B4MRL_ASSIGN_OR_RETURN(const Hyperparameter* entry, Need(name));
  const std::vector<std::string_view> names = entry->ChoiceNames();
  if (names.empty()) {
    B4MRL_ASSIGN_OR_RETURN(const double value, ParseFinite(name, text, entry->low, entry->high));
    return Set(name, value);
  }
  if (entry->IsSwitch() && (text == "0" || text == "1")) return Set(name, text == "1");
  const auto choice = std::find(names.begin(), names.end(), text);
  if (choice == names.end()) return UnknownName(name, text, names);
  return Set(name, static_cast<double>(choice - names.begin()));
}

const Hyperparameter* Hyperparameters::Find(std::string_view name) const {
  const auto entry = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Hyperparameter& e) { return e.name == name; });
  return entry == entries_.end() ? nullptr : &*entry;
}

double Hyperparameters::Number(std::string_view name) const { return Known(name).value; }

double Hyperparameters::NumberOr(std::string_view name, double fallback) const {
  const Hyperparameter* entry = Find(name);
  return entry == nullptr ? fallback : entry->value;
}

bool Hyperparameters::Chosen(std::string_view name, std::string_view choice) const {
  const Hyperparameter& entry = Known(name);
  const std::vector<std::string_view> names = entry.ChoiceNames();
  const auto found = std::ranges::find(names, choice);
  if (found == names.end()) Abort(fmt::format("'{}' is no choice of '{}'", choice, name));
  return entry.value == static_cast<double>(found - names.begin());
}

const Hyperparameter& Hyperparameters::Known(std::string_view name) const {
  const Hyperparameter* entry = Find(name);
  if (entry == nullptr) {
    Abort(fmt::format("there is no hyperparameter '{}' in the learner's table", name));
  }
  return *entry;
}

Result<Hyperparameter*> Hyperparameters::Need(std::string_view name) {
  std::vector<std::string_view> names;
  for (Hyperparameter& entry : entries_) {
    if (entry.name == name) return &entry;
    names.push_back(entry.name);
  }
  return UnknownName("hyperparameter", name, names);
}

}  // namespace b4mrl

// What a user may set of a learner, and the values in force. Value types; no thread rule.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

struct EnvironmentDefault {
  std::string_view environment;
  double value;
};

// What a user may set: `--<name> value` or `<name> = value` in a TOML file. A number, or one of
// several choices, which users give by name.
struct Hyperparameter {
  std::string_view name;
  double value;  // the default
  double low;    // allowed range
  double high;
  bool whole;  // takes whole numbers only
  std::string_view meaning;
  std::string_view unit = {};     // "updates", "rows", "steps"; none: a pure number
  std::string_view source = {};   // who chose the default, and why where sources disagree
  std::string_view choices = {};  // "deterministic|gaussian": the value is the place in this list
  std::span<const EnvironmentDefault> by_environment = {};  // where another default holds

  // The names in `choices`; none for a number.
  std::vector<std::string_view> ChoiceNames() const;
  // Takes "true" and "false" too, as TOML has them.
  bool IsSwitch() const { return whole && low == 0 && high == 1 && choices.empty(); }
  // A value as users write it: "0.0003", "gaussian".
  std::string TextOf(double any) const;
  std::string Text() const { return TextOf(value); }
};

// The values in force: a learner's table with the user's changes.
class Hyperparameters {
 public:
  Hyperparameters() = default;
  // The defaults, those for `environment` where it has its own.
  explicit Hyperparameters(std::span<const Hyperparameter> table,
                           std::string_view environment = {});

  // kUnknownName with the nearest known one; kInvalidArgument with the allowed range.
  Status Set(std::string_view name, double value);
  // The value as a user wrote it. A choice goes by its name only: its number is nobody's business.
  Status SetText(std::string_view name, std::string_view text);
  // nullptr when `name` does not stand in the table.
  const Hyperparameter* Find(std::string_view name) const;
  // Ends the program with the name when it does not stand in the table: a programmer's error.
  double Number(std::string_view name) const;
  // The same where the table may lack the name: then `fallback`.
  double NumberOr(std::string_view name, double fallback) const;
  int Integer(std::string_view name) const { return static_cast<int>(Number(name)); }
  uint64_t Unsigned(std::string_view name) const { return static_cast<uint64_t>(Number(name)); }
  const std::vector<Hyperparameter>& entries() const { return entries_; }

 private:
  Result<Hyperparameter*> Need(std::string_view name);

  std::vector<Hyperparameter> entries_;
};

}  // namespace b4mrl

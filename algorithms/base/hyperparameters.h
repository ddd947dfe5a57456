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
// several choices, which users give by name. Real, Whole, Switch and Choice below make them.
struct Hyperparameter {
  std::string_view name;
  double value = 0;  // the default
  double low = 0;    // allowed range
  double high = 0;
  bool whole = false;  // takes whole numbers only
  std::string_view meaning;
  std::string_view unit = {};     // "updates", "rows", "steps"; none: a pure number
  std::string_view source = {};   // who chose the default, and why where sources disagree
  std::string_view choices = {};  // "deterministic|gaussian": the value is the place in this list
  std::span<const EnvironmentDefault> by_environment = {};  // where another default holds

  // The names in `choices`; empty for a number.
  std::vector<std::string_view> ChoiceNames() const;
  // Whether the choices are false and true, which 0 and 1 stand for as well.
  bool IsSwitch() const { return choices == "false|true"; }
  // A value as users write it: "0.0003", "gaussian".
  std::string TextOf(double any) const;
  std::string Text() const { return TextOf(value); }
};

struct Range {
  double low, high;
};

// What a number's row may say besides: the fields of that name in Hyperparameter.
struct RowDetails {
  std::string_view unit = {};
  std::string_view source = {};
  std::span<const EnvironmentDefault> by_environment = {};
};

// A row for a real number, for a whole number, for true or false, and for one of several choices.
Hyperparameter Real(std::string_view name, double value, Range range, std::string_view meaning,
                    const RowDetails& details = {});
Hyperparameter Whole(std::string_view name, double value, Range range, std::string_view meaning,
                     const RowDetails& details = {});
Hyperparameter Switch(std::string_view name, bool value, std::string_view meaning,
                      std::string_view source);
Hyperparameter Choice(std::string_view name, std::string_view choices, int value,
                      std::string_view meaning, std::string_view source);

// The rows of a learner's table: its own, then those that it shares with others.
using HyperparameterTable = std::vector<Hyperparameter>;
HyperparameterTable operator+(HyperparameterTable table, const HyperparameterTable& more);

// The values in force: a learner's table with the user's changes.
class Hyperparameters {
 public:
  Hyperparameters() = default;
  // The table's defaults; where a row has another default for `environment`, that one.
  explicit Hyperparameters(std::span<const Hyperparameter> table,
                           std::string_view environment = {});

  // kUnknownName with the nearest known one; kInvalidArgument with the allowed range.
  Status Set(std::string_view name, double value);
  // The value as a user wrote it. Choices are set by name; their numeric codes are internal.
  Status SetText(std::string_view name, std::string_view text);
  // nullptr when `name` does not stand in the table.
  const Hyperparameter* Find(std::string_view name) const;
  // Ends the program with the name when it does not stand in the table: a programmer's error.
  double Number(std::string_view name) const;
  // The value of `name`, or `fallback` where the table lacks it.
  double NumberOr(std::string_view name, double fallback) const;
  int Integer(std::string_view name) const { return static_cast<int>(Number(name)); }
  uint64_t Unsigned(std::string_view name) const { return static_cast<uint64_t>(Number(name)); }
  const std::vector<Hyperparameter>& entries() const { return entries_; }

 private:
  Result<Hyperparameter*> Need(std::string_view name);

  std::vector<Hyperparameter> entries_;
};

}  // namespace b4mrl

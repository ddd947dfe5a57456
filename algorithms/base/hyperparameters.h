// Hyperparameters of a learner: the table of those that a user may set, and the values in force.
// Value types; no thread rule.
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

// One hyperparameter, set by `--<name> value` or by `<name> = value` in a TOML file: a number, or a
// choice among several names. Real, Whole, Switch and Choice below make hyperparameters.
struct Hyperparameter {
  std::string_view name;
  double value = 0;  // the default
  double low = 0;    // allowed range
  double high = 0;
  bool whole = false;  // takes whole numbers only
  std::string_view meaning;
  std::string_view unit = {};     // "updates", "rows", "steps"; empty: a number without a unit
  std::string_view source = {};   // who chose the default, and why where sources disagree
  std::string_view choices = {};  // "deterministic|gaussian": `value` is an index into this list
  std::span<const EnvironmentDefault> by_environment = {};  // environments with another default
  // No number of a run depends on it: it may differ between a run's parts and is not in its id.
  bool is_without_effect = false;

  // The names in `choices`; empty if the hyperparameter is a number.
  std::vector<std::string_view> ChoiceNames() const;
  // Whether the choices are false and true; users may write 0 and 1 for them, too.
  bool IsSwitch() const { return choices == "false|true"; }
  // TextOf writes `any`, Text the present value, as users write values: "0.0003", "gaussian".
  std::string TextOf(double any) const;
  std::string Text() const { return TextOf(value); }
};

struct Range {
  double low, high;
};

// Optional fields of a numeric hyperparameter, with the meaning that they have in Hyperparameter.
struct RowDetails {
  std::string_view unit = {};
  std::string_view source = {};
  std::span<const EnvironmentDefault> by_environment = {};
};

// Table rows: Real makes a real number, Whole a whole number, Switch true or false, and Choice a
// choice among the names in `choices`, of which `value` is the default's index.
Hyperparameter Real(std::string_view name, double value, Range range, std::string_view meaning,
                    const RowDetails& details = {});
Hyperparameter Whole(std::string_view name, double value, Range range, std::string_view meaning,
                     const RowDetails& details = {});
Hyperparameter Switch(std::string_view name, bool value, std::string_view meaning,
                      std::string_view source);
Hyperparameter Choice(std::string_view name, std::string_view choices, int value,
                      std::string_view meaning, std::string_view source);
// The row as one on which no number of a run depends.
Hyperparameter WithoutEffect(Hyperparameter row);

// A learner's hyperparameters. operator+ appends rows that several learners share to its own.
using HyperparameterTable = std::vector<Hyperparameter>;
HyperparameterTable operator+(HyperparameterTable table, const HyperparameterTable& more);

// The hyperparameter values in force: the defaults of a learner's table with the user's changes.
class Hyperparameters {
 public:
  Hyperparameters() = default;
  // Starts from the table's defaults; a default given for `environment` goes before the general.
  explicit Hyperparameters(std::span<const Hyperparameter> table,
                           std::string_view environment = {});

  // kUnknownName suggests the nearest known name; kInvalidArgument states the allowed range.
  Status Set(std::string_view name, double value);
  // Sets a value from the text that a user wrote. Choices are set by name, not by index.
  Status SetText(std::string_view name, std::string_view text);
  // nullptr when `name` does not stand in the table.
  const Hyperparameter* Find(std::string_view name) const;
  // The value of `name`. Aborts, naming it, if the table lacks `name`: a programming error.
  double Number(std::string_view name) const;
  // The value of `name`, or `fallback` if the table lacks `name`.
  double NumberOr(std::string_view name, double fallback) const;
  // Whether the value of `name` is this choice, "gaussian", or "true" of a switch. Aborts like
  // Number.
  bool Chosen(std::string_view name, std::string_view choice) const;
  int Integer(std::string_view name) const { return static_cast<int>(Number(name)); }
  uint64_t Unsigned(std::string_view name) const { return static_cast<uint64_t>(Number(name)); }
  const std::vector<Hyperparameter>& entries() const { return entries_; }

 private:
  const Hyperparameter& Known(std::string_view name) const;
  Result<Hyperparameter*> Need(std::string_view name);

  std::vector<Hyperparameter> entries_;
};

}  // namespace b4mrl

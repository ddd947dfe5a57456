#include "benchmarks/runner/budget.h"

#include <fmt/format.h>

#include <set>
#include <string_view>

#include "data/files/toml_file.h"
#include "proto/base/folders.h"

namespace b4mrl {
namespace {

Status Refuse(const std::string& where, std::string_view allowed) {
  return Status(StatusCode::kInvalidArgument, fmt::format("{} must be {}", where, allowed));
}

Status TakeCount(const toml::node& node, const std::string& where, uint64_t* out) {
  const auto number = node.value_exact<int64_t>();
  if (!number || *number < 1) return Refuse(where, "a whole number of at least 1");
  *out = static_cast<uint64_t>(*number);
  return Status();
}

Status TakeNumbers(const toml::node& node, const std::string& where, HyperparameterValues* out) {
  const toml::table* table = node.as_table();
  if (table == nullptr) return Refuse(where, "a table of numbers");
  for (const auto& [key, value] : *table) {
    const auto number = value.is_boolean() ? std::nullopt : value.value<double>();
    if (!number) return Refuse(fmt::format("{}.{}", where, key.str()), "a number");
    (*out)[std::string(key.str())] = *number;
  }
  return Status();
}

Status TakeTexts(const toml::node& node, const std::string& where, std::vector<std::string>* out) {
  const toml::array* array = node.as_array();
  for (size_t i = 0; array != nullptr && i < array->size(); ++i) {
    const auto text = (*array)[i].value_exact<std::string>();
    if (!text) return Refuse(where, "a list of texts");
    out->push_back(*text);
  }
  return array == nullptr ? Refuse(where, "a list of texts") : Status();
}

Status Unknown(const std::string& where, std::string_view key, std::vector<std::string> known) {
  return UnknownName(fmt::format("key of {}", where), std::string(key), known);
}

Status TakeException(const toml::node& node, const std::string& where, BudgetException* out) {
  const toml::table* table = node.as_table();
  if (table == nullptr) return Refuse(where, "tables");
  for (const auto& [key, value] : *table) {
    const std::string name(key.str());
    const std::string at = fmt::format("{}.{}", where, name);
    Status status;
    if (name == "algorithms") {
      status = TakeTexts(value, at, &out->algorithms);
    } else if (name == "simulators") {
      status = TakeTexts(value, at, &out->simulators);
    } else if (name == "datasets") {
      status = TakeTexts(value, at, &out->datasets);
    } else if (name == "updates") {
      status = TakeCount(value, at, &out->updates.emplace());
    } else if (name == "hyperparameters") {
      status = TakeNumbers(value, at, &out->hyperparameters);
    } else {
      return Unknown(where, name,
                     {"algorithms", "simulators", "datasets", "updates", "hyperparameters"});
    }
    B4MRL_RETURN_IF_ERROR(status);
  }
  return Status();
}

Status TakeExceptions(const toml::node& node, const std::string& where, Budget* out) {
  const toml::array* array = node.as_array();
  if (array == nullptr) return Refuse(where, "tables");
  for (const toml::node& entry : *array) {
    B4MRL_RETURN_IF_ERROR(TakeException(entry, where, &out->exceptions.emplace_back()));
  }
  return Status();
}

// Calls take(name, value) for each entry of a table by algorithm.
template <typename Take>
Status ForEach(const toml::node& node, const std::string& where, Take take) {
  const toml::table* table = node.as_table();
  if (table == nullptr) return Refuse(where, "a table by algorithm");
  for (const auto& [key, value] : *table) {
    B4MRL_RETURN_IF_ERROR(
        take(std::string(key.str()), value, fmt::format("{}.{}", where, key.str())));
  }
  return Status();
}

Status TakeEntry(const std::string& name, const toml::node& value, const std::string& at,
                 Budget* out) {
  uint64_t count = 0;
  if (name == "evaluations") return TakeCount(value, at, &out->evaluations);
  if (name == "rows") return TakeCount(value, at, &out->rows.emplace());
  if (name == "episodes" || name == "seeds") {
    B4MRL_RETURN_IF_ERROR(TakeCount(value, at, &count));
    if (count > 10'000) return Refuse(at, "at most 10000");
    (name == "seeds" ? out->seeds : out->episodes) = static_cast<uint32_t>(count);
    return Status();
  }
  if (name == "precision") {
    out->precision = value.value_or(std::string());
    const bool known = out->precision == "fp32" || out->precision == "bf16";
    return known ? Status() : Refuse(at, "\"fp32\" or \"bf16\"");
  }
  if (name == "updates") {
    return ForEach(value, at,
                   [&](std::string algorithm, const toml::node& number, const std::string& where) {
                     return TakeCount(number, where, &out->updates[algorithm]);
                   });
  }
  if (name == "hyperparameters") {
    return ForEach(value, at,
                   [&](std::string algorithm, const toml::node& numbers, const std::string& where) {
                     return TakeNumbers(numbers, where, &out->hyperparameters[algorithm]);
                   });
  }
  if (name == "exception") return TakeExceptions(value, at, out);
  return Unknown(at.substr(0, at.rfind('.')), name,
                 {"evaluations", "rows", "episodes", "seeds", "precision", "updates",
                  "hyperparameters", "exception"});
}

}  // namespace

Result<Budget> ReadBudget(const std::string& file, const std::string& name) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table all, ReadTomlFile(file));
  const bool is_only = name.empty() && all.size() == 1;
  const std::string chosen(is_only ? all.begin()->first.str() : std::string_view(name));
  const toml::table* table = all[chosen].as_table();
  if (table == nullptr) {
    std::vector<std::string> names;
    for (const auto& [key, node] : all) names.emplace_back(key.str());
    return UnknownName(fmt::format("budget of {}", file), chosen, names);
  }
  Budget budget;
  budget.name = chosen;
  for (const auto& [key, value] : *table) {
    const std::string entry(key.str());
    B4MRL_RETURN_IF_ERROR(
        TakeEntry(entry, value, fmt::format("{}.{}", chosen, entry), &budget).WithContext(file));
  }
  if (budget.updates.empty()) {
    return Refuse(fmt::format("{}: {}.updates", file, chosen), "a table with an algorithm or more");
  }
  return budget;
}

std::string DefaultBudgetsFile() {
  return SharedFolder("", B4MRL_BENCHMARKS_FOLDER) + "/budgets.toml";
}

}  // namespace b4mrl

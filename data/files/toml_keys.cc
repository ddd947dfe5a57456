#include "data/files/toml_keys.h"

#include <fmt/format.h>

#include <algorithm>

namespace b4mrl {
namespace {

std::optional<double> NumberIn(const toml::node& node) {
  return node.is_boolean() ? std::nullopt : node.value<double>();
}

std::optional<uint64_t> CountIn(const toml::node& node) {
  const auto number = node.value_exact<int64_t>();
  return number && *number >= 1 ? std::optional<uint64_t>(*number) : std::nullopt;
}

std::optional<std::string> ValueIn(const toml::node& node) {
  if (node.is_boolean()) return fmt::format("{}", *node.value<bool>());
  if (const auto number = NumberIn(node)) return fmt::format("{}", *number);
  return node.value_exact<std::string>();
}

}  // namespace

Result<std::string> TomlKeys::Text(std::string_view key, bool required) {
  const toml::node* node = Find(key);
  if (node == nullptr && !required) return std::string();
  const auto text = node == nullptr ? std::nullopt : node->value_exact<std::string>();
  if (!text || text->empty()) return Refuse(key, "a text that is not empty");
  B4MRL_RETURN_IF_ERROR(Check(key, *text));
  return *text;
}

Result<std::vector<std::string>> TomlKeys::Texts(std::string_view key,
                                                 std::vector<std::string> otherwise) {
  const toml::node* node = Find(key);
  if (node == nullptr) return otherwise;
  const toml::array* array = node->as_array();
  if (array == nullptr || array->empty()) return Refuse(key, "a list of texts that is not empty");
  std::vector<std::string> texts;
  for (const toml::node& entry : *array) {
    const auto text = entry.value_exact<std::string>();
    if (!text) return Refuse(key, "a list of texts");
    B4MRL_RETURN_IF_ERROR(Check(key, *text));
    texts.push_back(*text);
  }
  return texts;
}

Result<std::optional<uint64_t>> TomlKeys::Count(std::string_view key, uint64_t most) {
  const toml::node* node = Find(key);
  if (node == nullptr) return std::optional<uint64_t>();
  const auto count = CountIn(*node);
  if (count && *count <= most) return count;
  return Refuse(key, most == INT64_MAX ? "a whole number of at least 1"
                                       : fmt::format("a whole number in 1..{}", most));
}

template <typename Value, typename Take>
Result<std::map<std::string, Value>> TomlKeys::Entries(std::string_view key,
                                                       std::string_view allowed, Take take) {
  std::map<std::string, Value> entries;
  const toml::node* node = Find(key);
  if (node == nullptr) return entries;
  const toml::table* table = node->as_table();
  if (table == nullptr) return Refuse(key, fmt::format("a table of {}", allowed));
  for (const auto& [name, value] : *table) {
    const auto taken = take(value);
    if (!taken) {
      return Refuse(fmt::format("{}.{}", key, name.str()),
                    fmt::format("an entry of a table of {}", allowed));
    }
    entries.emplace(std::string(name.str()), *taken);
  }
  return entries;
}

Result<std::map<std::string, double>> TomlKeys::Numbers(std::string_view key) {
  return Entries<double>(key, "numbers", NumberIn);
}

Result<std::map<std::string, uint64_t>> TomlKeys::Counts(std::string_view key) {
  return Entries<uint64_t>(key, "whole numbers of at least 1", CountIn);
}

Result<std::map<std::string, std::string>> TomlKeys::NamedTexts(std::string_view key) {
  B4MRL_ASSIGN_OR_RETURN(auto texts, Entries<std::string>(key, "texts", [](const toml::node& node) {
                           return node.value_exact<std::string>();
                         }));
  for (const auto& [name, text] : texts) {
    B4MRL_RETURN_IF_ERROR(Check(fmt::format("{}.{}", key, name), text));
  }
  return texts;
}

Result<std::map<std::string, std::string>> TomlKeys::NamedValues(std::string_view key) {
  return Entries<std::string>(key, "numbers, texts, true and false", ValueIn);
}

Result<const toml::table*> TomlKeys::Table(std::string_view key) {
  const toml::node* node = Find(key);
  const toml::table* table = node == nullptr ? nullptr : node->as_table();
  if (node != nullptr && table == nullptr) return Refuse(key, "a table");
  return table;
}

Result<std::vector<const toml::table*>> TomlKeys::Tables(std::string_view key) {
  std::vector<const toml::table*> tables;
  const toml::node* node = Find(key);
  if (node == nullptr) return tables;
  const toml::array* array = node->as_array();
  for (size_t i = 0; array != nullptr && i < array->size(); ++i) {
    tables.push_back((*array)[i].as_table());
  }
  if (tables.empty() || std::ranges::count(tables, nullptr) > 0) {
    return Refuse(key, fmt::format("tables [[{}]]", key));
  }
  return tables;
}

Status TomlKeys::Finish() const {
  for (const auto& [key, node] : table_) {
    if (known_.contains(key.str())) continue;
    const Status unknown = UnknownName(fmt::format("key of {}", where_), key.str(), known_);
    // What is wrong is the file, not a name that the user has given to a command.
    return Status(StatusCode::kInvalidArgument, unknown.message());
  }
  return Status();
}

const toml::node* TomlKeys::Find(std::string_view key) {
  known_.emplace(key);
  return table_.get(key);
}

Status TomlKeys::Refuse(std::string_view key, std::string_view allowed) const {
  return Status(StatusCode::kInvalidArgument,
                fmt::format("{}: '{}' must be {}", where_, key, allowed));
}

Status TomlKeys::Check(std::string_view key, const std::string& text) const {
  const Status status = check_ == nullptr ? Status() : check_(text);
  return status.ok() ? status : Refuse(key, status.message());
}

}  // namespace b4mrl

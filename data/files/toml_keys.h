// The keys of one table of a TOML file, read with checks.
//
// Reading a key marks it as known; Finish then refuses keys that nobody asked for, which are
// mistakes of whoever wrote the file. Errors: kInvalidArgument, which names the table, the key and
// what is allowed there, of an unknown key the nearest one. Thread rule: one thread. The table
// outlives the reader.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "data/files/toml_file.h"
#include "proto/base/status.h"

namespace b4mrl {

class TomlKeys {
 public:
  // Says whether a text may stand in the file; an error says what may.
  using CheckText = std::function<Status(const std::string& text)>;

  // `where` names the table in messages: "mine.toml, challenge 'confounding'".
  TomlKeys(const toml::table& table, std::string where, CheckText check = nullptr)
      : table_(table), where_(std::move(where)), check_(std::move(check)) {}

  // "" where the key is missing and not required.
  Result<std::string> Text(std::string_view key, bool required = false);
  // `otherwise` where the key is missing.
  Result<std::vector<std::string>> Texts(std::string_view key,
                                         std::vector<std::string> otherwise = {});
  // A whole number from 1 to `most`; none where the key is missing.
  Result<std::optional<uint64_t>> Count(std::string_view key, uint64_t most = INT64_MAX);

  // Tables of values by name; empty where the key is missing.
  Result<std::map<std::string, double>> Numbers(std::string_view key);
  Result<std::map<std::string, uint64_t>> Counts(std::string_view key);
  Result<std::map<std::string, std::string>> NamedTexts(std::string_view key);
  // Numbers, texts, true and false, as command lines take them: "0.0003", "gaussian", "true".
  Result<std::map<std::string, std::string>> NamedValues(std::string_view key);
  // The table `key`; nullptr where the key is missing.
  Result<const toml::table*> Table(std::string_view key);
  // The tables [[key]], in the file's order; none where the key is missing.
  Result<std::vector<const toml::table*>> Tables(std::string_view key);

  Status Finish() const;

 private:
  const toml::node* Find(std::string_view key);
  // The entries of the table `key`, each made by take(name, value), which returns an optional:
  // nothing for a value that is not `allowed`.
  template <typename Value, typename Take>
  Result<std::map<std::string, Value>> Entries(std::string_view key, std::string_view allowed,
                                               Take take);
  Status Refuse(std::string_view key, std::string_view allowed) const;
  Status Check(std::string_view key, const std::string& text) const;

  const toml::table& table_;
  const std::string where_;
  const CheckText check_;
  std::set<std::string, std::less<>> known_;
};

}  // namespace b4mrl

#include "benchmarks/records/json_file.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <system_error>

#include "data/files/atomic_file.h"
#include "proto/wire/json_depth.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kMaxDepth = 32;  // lists and objects inside each other

// The word of the first number that is not finite, as Python's json.dump writes it; "": none.
std::string_view InfiniteNumber(std::string_view text) {
  bool in_string = false;
  for (size_t i = 0; i < text.size(); ++i) {
    if (in_string && text[i] == '\\') {
      ++i;  // the escaped character
      continue;
    }
    if (text[i] == '"') in_string = !in_string;
    if (in_string) continue;
    for (const std::string_view word : {"NaN", "Infinity", "-Infinity"}) {
      if (text.substr(i).starts_with(word)) return word;
    }
  }
  return "";
}

}  // namespace

Result<Json> ParseJsonObject(std::string_view text, std::string_view name) {
  Json json = ParseShallow<Json>(text, kMaxDepth);
  if (json.is_object()) return json;
  if (const auto word = InfiniteNumber(text); !word.empty()) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("{} holds no JSON object: {} is no number of JSON, allowed: finite "
                              "numbers",
                              name, word));
  }
  return Status(StatusCode::kDataLoss, fmt::format("{} holds no JSON object", name));
}

Result<Json> ReadJsonObject(const std::string& path, size_t max_bytes) {
  // Opening a pipe would wait for whoever writes into it.
  std::error_code error;
  if (std::filesystem::exists(path, error) && !std::filesystem::is_regular_file(path, error)) {
    return Status(StatusCode::kDataLoss, fmt::format("{} is no regular file", path));
  }
  B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(path, max_bytes));
  return ParseJsonObject(text, path);
}

const Json& EntryOf(const Json& object, std::string_view key) {
  static const Json kNothing;
  if (!object.is_object()) return kNothing;
  const auto found = object.find(std::string(key));
  return found == object.end() ? kNothing : *found;
}

std::string TextOf(const Json& object, std::string_view key) {
  const Json& entry = EntryOf(object, key);
  return entry.is_string() ? entry.get<std::string>() : "";
}

std::optional<double> NumberOf(const Json& object, std::string_view key) {
  const Json& entry = EntryOf(object, key);
  return entry.is_number() ? std::optional(entry.get<double>()) : std::nullopt;
}

std::optional<uint64_t> CountOf(const Json& object, std::string_view key) {
  const Json& entry = EntryOf(object, key);
  return entry.is_number_unsigned() ? std::optional(entry.get<uint64_t>()) : std::nullopt;
}

bool IsTrue(const Json& object, std::string_view key) {
  const Json& entry = EntryOf(object, key);
  return entry.is_boolean() && entry.get<bool>();
}

std::optional<std::vector<double>> NumbersOf(const Json& object, std::string_view key) {
  const Json& entry = EntryOf(object, key);
  if (!entry.is_array()) return std::nullopt;
  std::vector<double> numbers;
  for (const Json& each : entry) {
    if (!each.is_number() || !std::isfinite(each.get<double>())) return std::nullopt;
    numbers.push_back(each.get<double>());
  }
  return numbers;
}

}  // namespace b4mrl

#include "benchmarks/records/json_file.h"

#include <fmt/format.h>
#include <sys/mman.h>

#include <cmath>
#include <filesystem>
#include <system_error>

#include "data/files/atomic_file.h"
#include "proto/wire/json_depth.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kMaxDepth = 32;  // lists and objects inside each other
// Of one object. An ordered one looks through all that it has for each further entry: four
// megabytes of them would take minutes.
constexpr size_t kMaxEntries = 1'000;
// Of memory for each byte of a text, while it is read or what was read is destroyed: at most 43 in
// a list of empty texts, three bytes each, whose place in it takes 16 and whose own memory 48; the
// list has grown to twice its length, and is taken apart through a copy that grows likewise.
constexpr size_t kMemoryPerByte = 48;

// Whether this process can have so much memory more.
bool CanHave(size_t bytes) {
  void* const tried =
      mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (tried == MAP_FAILED) return false;
  munmap(tried, bytes);
  return true;
}

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
  // A value of nlohmann's allocates memory while it is destroyed. Where none is left, as below
  // `ulimit -v`, that ends the process, so it has to show before there is a value.
  if (const size_t bytes = kMemoryPerByte * (text.size() + 1); !CanHave(bytes)) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("not enough memory to read {}: its {} bytes may take {} MiB", name,
                              text.size(), (bytes >> 20) + 1));
  }
  if (HasLargerObject(text, kMaxEntries)) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} has an object with more than {} entries", name, kMaxEntries));
  }
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

std::vector<std::string> TextsOf(const Json& object, std::string_view key) {
  std::vector<std::string> texts;
  for (const Json& each : EntryOf(object, key)) {
    if (each.is_string()) texts.push_back(each.get<std::string>());
  }
  return texts;
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

// JSON objects in files of runs and results, read without exceptions whatever the files hold.
//
// An entry that is missing or of another kind reads as empty: "", nothing, null. Pure functions;
// any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// Of a file that others may have written: a result has some KB, or a MB with 10,000 points of a
// curve, and what is read takes several times as much memory.
inline constexpr size_t kMaxResultBytes = 4 << 20;
// Of a file of this user's own learners and plans.
inline constexpr size_t kMaxOwnFileBytes = 64 << 20;

// `name` is that of the text in the error. kDataLoss if the text is no JSON object, or nests values
// deeper than 32, as copies and writers of JSON recurse; it names NaN and infinite numbers, which
// are no JSON. kLimitExceeded if the process cannot have the memory that such a text may take.
Result<nlohmann::ordered_json> ParseJsonObject(std::string_view text, std::string_view name);
// kIoError; kDataLoss and kLimitExceeded as above; kLimitExceeded for a longer file, too.
Result<nlohmann::ordered_json> ReadJsonObject(const std::string& path,
                                              size_t max_bytes = kMaxResultBytes);

// The entry `key` of an object; null if there is none.
const nlohmann::ordered_json& EntryOf(const nlohmann::ordered_json& object, std::string_view key);
std::string TextOf(const nlohmann::ordered_json& object, std::string_view key);
std::optional<double> NumberOf(const nlohmann::ordered_json& object, std::string_view key);
std::optional<uint64_t> CountOf(const nlohmann::ordered_json& object, std::string_view key);
bool IsTrue(const nlohmann::ordered_json& object, std::string_view key);
// The texts of a list; other entries are passed over.
std::vector<std::string> TextsOf(const nlohmann::ordered_json& object, std::string_view key);
// The finite numbers of a list; nothing if it is no list or has other entries.
std::optional<std::vector<double>> NumbersOf(const nlohmann::ordered_json& object,
                                             std::string_view key);

}  // namespace b4mrl

#include "benchmarks/records/plain_text.h"

#include <algorithm>
#include <cstddef>

#include "proto/wire/utf8.h"

namespace b4mrl {
namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";  // U+FFFD
constexpr size_t kMostShownBytes = 1'000;                  // of one line

}  // namespace

std::string WithoutControls(std::string_view text) {
  std::string plain;
  while (!text.empty()) {
    const auto [bytes, code] = FirstUtf8Character(text);
    const bool is_control = code < 0x20 || (code >= 0x7F && code < 0xA0);
    plain += bytes == 0 || is_control ? kReplacement : text.substr(0, bytes);
    text.remove_prefix(std::max<size_t>(bytes, 1));
  }
  return plain;
}

void ReplaceControls(nlohmann::ordered_json* json) {
  if (json->is_string()) *json = WithoutControls(json->get_ref<const std::string&>());
  if (!json->is_structured()) return;
  for (nlohmann::ordered_json& each : *json) ReplaceControls(&each);
}

std::string OnOneLine(std::string_view text) {
  if (text.size() <= kMostShownBytes) return WithoutControls(text);
  return WithoutControls(text.substr(0, kMostShownBytes)) + "...";
}

}  // namespace b4mrl

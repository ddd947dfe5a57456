#include "proto/base/count.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <optional>

namespace b4mrl {
namespace {

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// The decimal digits of the number in `text`, or nothing if the number is not whole.
std::optional<std::string> PlainDigits(std::string_view text) {
  constexpr size_t kMaxLength = 64;
  constexpr size_t kMaxDigits = 20;  // digits of the largest 64-bit number
  if (text.size() > kMaxLength) return std::nullopt;
  const size_t exponent_at = std::min(text.find_first_of("eE"), text.size());
  const std::string_view mantissa = text.substr(0, exponent_at);
  const size_t point = std::min(mantissa.find('.'), mantissa.size());
  std::string digits(mantissa.substr(0, point));
  const std::string_view fraction = mantissa.substr(std::min(point + 1, mantissa.size()));
  digits += fraction;
  if (digits.empty() || !std::all_of(digits.begin(), digits.end(), IsDigit)) return std::nullopt;

  size_t exponent = 0;
  if (exponent_at < text.size()) {
    std::string_view written = text.substr(exponent_at + 1);
    if (written.starts_with('+')) written.remove_prefix(1);
    const auto [end, error] =
        std::from_chars(written.data(), written.data() + written.size(), exponent);
    if (written.empty() || error != std::errc() || end != written.data() + written.size()) {
      return std::nullopt;
    }
  }
  size_t behind_point = fraction.size();
  for (; behind_point > exponent; --behind_point) {
    if (digits.back() != '0') return std::nullopt;
    digits.pop_back();
  }
  digits.erase(0, digits.find_first_not_of('0'));
  if (digits.empty()) return "0";
  if (exponent - behind_point > kMaxDigits) return std::nullopt;
  return digits.append(exponent - behind_point, '0');
}

}  // namespace

Result<uint64_t> ParseCount(std::string_view text, uint64_t low, uint64_t high) {
  const std::optional<std::string> digits = PlainDigits(text);
  uint64_t value = 0;
  bool fits = digits.has_value();
  if (fits) {
    const char* end = digits->data() + digits->size();
    fits = std::from_chars(digits->data(), end, value).ec == std::errc();
  }
  if (!fits || value < low || value > high) {
    constexpr size_t kMaxShown = 64;
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{}{} is not a whole number in {}..{}", text.substr(0, kMaxShown),
                              text.size() > kMaxShown ? "..." : "", low, high));
  }
  return value;
}

std::function<std::string(std::string&)> CountText(uint64_t low, uint64_t high) {
  return [low, high](std::string& text) -> std::string {
    const Result<uint64_t> value = ParseCount(text, low, high);
    if (!value.ok()) return value.status().message();
    text = fmt::format("{}", *value);
    return "";
  };
}

}  // namespace b4mrl

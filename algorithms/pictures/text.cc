#include "algorithms/pictures/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>

#include "proto/wire/utf8.h"

namespace b4mrl {
namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";  // U+FFFD

// A character of UTF-8: how many bytes it has, and whether XML allows it.
struct Character {
  size_t bytes = 1;
  bool valid = false;
};

Character FirstCharacter(std::string_view text) {
  const auto [bytes, code] = FirstUtf8Character(text);
  const bool is_control = (code < 0x20 && code != '\n' && code != '\t') || code == 0x7F;
  const bool is_noncharacter = (code & 0xFFFE) == 0xFFFE;
  const bool valid = bytes > 0 && !is_control && !is_noncharacter;
  return valid ? Character{bytes, true} : Character{};
}

// The width of a character as a share of the font size; DejaVu Sans is the widest font considered.
double CharacterWidth(std::string_view character) {
  constexpr std::string_view kNarrow = " .,:;'|!ijl()[]{}-/ft";
  constexpr std::string_view kWide = "mwMW%@";
  const char c = character[0];
  if (character.size() > 1) return 1;
  if (kNarrow.find(c) != std::string_view::npos) return 0.42;
  if (kWide.find(c) != std::string_view::npos) return 1;
  return c >= 'A' && c <= 'Z' ? 0.78 : 0.64;
}

// Calls `use` with each character of `text`, invalid ones as U+FFFD.
template <typename Use>
void ForEachCharacter(std::string_view text, const Use& use) {
  while (!text.empty()) {
    const Character character = FirstCharacter(text);
    use(character.valid ? text.substr(0, character.bytes) : kReplacement);
    text.remove_prefix(character.bytes);
  }
}

// Appends `word` to the last of `lines`, or to new ones where it does not fit.
void PlaceWord(std::string_view word, double font_size, double width,
               std::vector<std::string>* lines) {
  if (!lines->empty()) {
    const std::string longer = lines->back() + " " + std::string(word);
    if (TextWidth(longer, font_size) <= width) {
      lines->back() = longer;
      return;
    }
  }
  lines->emplace_back();
  ForEachCharacter(word, [&](std::string_view character) {
    const std::string longer = lines->back() + std::string(character);
    if (!lines->back().empty() && TextWidth(longer, font_size) > width) {
      lines->emplace_back(character);
    } else {
      lines->back() = longer;
    }
  });
}

// Puts commas between the thousands of a number's whole part.
std::string WithCommas(std::string digits) {
  const size_t first = digits.starts_with('-') ? 1 : 0;
  const size_t end = std::min(digits.find_first_not_of("0123456789", first), digits.size());
  for (size_t at = end; at > first + 3; at -= 3) digits.insert(at - 3, ",");
  return digits;
}

}  // namespace

std::string EscapeXml(std::string_view text) {
  std::string escaped;
  ForEachCharacter(text, [&](std::string_view character) {
    switch (character[0]) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        escaped += character;
    }
  });
  return escaped;
}

double TextWidth(std::string_view text, double font_size) {
  double width = 0;
  ForEachCharacter(text, [&](std::string_view character) { width += CharacterWidth(character); });
  return width * font_size;
}

std::vector<std::string> WrapText(std::string_view text, double font_size, double width) {
  std::vector<std::string> lines;
  while (!text.empty()) {
    const size_t end = std::min(text.find(' '), text.size());
    if (end > 0) PlaceWord(text.substr(0, end), font_size, width, &lines);
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

std::string FormatFixed(double value, int decimals) {
  const std::string digits = fmt::format("{:.{}f}", value, decimals);
  const bool is_zero = digits.find_first_not_of("-0.") == std::string::npos;
  return WithCommas(is_zero && digits.starts_with('-') ? digits.substr(1) : digits);
}

std::string FormatNumber(double value) {
  return WithCommas(fmt::format("{:.6g}", value == 0 ? 0.0 : value));
}

}  // namespace b4mrl

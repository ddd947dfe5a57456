// ASCII letters in lower case. Pure function; any thread.
#pragma once

#include <algorithm>
#include <cctype>
#include <string>

namespace b4mrl {

inline std::string LowerCase(std::string text) {
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

}  // namespace b4mrl

// Parts and forms of names. Pure functions; any thread.
#pragma once

#include <algorithm>
#include <cctype>
#include <string>
#include <string_view>

namespace b4mrl {

// ASCII letters in lower case.
inline std::string LowerCase(std::string text) {
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

// The version at the end of a name: "-v0" of "HalfCheetah/medium-v0"; "" if it has none.
inline std::string_view VersionOf(std::string_view name) {
  const size_t dash = name.rfind("-v");
  const bool has_version = dash != name.npos && dash + 2 < name.size() &&
                           name.find_first_not_of("0123456789", dash + 2) == name.npos;
  return has_version ? name.substr(dash) : "";
}

inline std::string_view WithoutVersion(std::string_view name) {
  return name.substr(0, name.size() - VersionOf(name).size());
}

}  // namespace b4mrl

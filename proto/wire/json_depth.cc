#include "proto/wire/json_depth.h"

#include <vector>

namespace b4mrl {
namespace {

// Calls see(c) -> bool for each character outside of JSON's texts until it is true; whether it was.
template <typename See>
bool AnyOutsideTexts(std::string_view json, See see) {
  bool in_string = false;
  for (size_t i = 0; i < json.size(); ++i) {
    const char c = json[i];
    if (in_string && c == '\\') {
      ++i;  // the escaped character
    } else if (c == '"') {
      in_string = !in_string;
    } else if (!in_string && see(c)) {
      return true;
    }
  }
  return false;
}

bool Opens(char c) { return c == '[' || c == '{'; }
bool Closes(char c) { return c == ']' || c == '}'; }

}  // namespace

bool NestsDeeper(std::string_view json, int most) {
  int depth = 0;
  return AnyOutsideTexts(json, [&depth, most](char c) {
    depth += Opens(c) ? 1 : Closes(c) ? -1 : 0;
    return depth > most;
  });
}

bool HasLargerObject(std::string_view json, size_t most) {
  std::vector<size_t> entries(1);  // of what a place is inside of, the text itself first
  return AnyOutsideTexts(json, [&entries, most](char c) {
    if (Opens(c)) entries.push_back(0);
    if (Closes(c) && entries.size() > 1) entries.pop_back();
    return c == ':' && ++entries.back() > most;
  });
}

}  // namespace b4mrl

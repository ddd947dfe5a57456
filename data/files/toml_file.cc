#include "data/files/toml_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <string_view>
#include <utility>

#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

constexpr size_t kMaxFileBytes = 1 << 20;
// toml++ makes a table of each part of a key "a.b.c", and destroys them by recursion: half a
// megabyte of them would overflow the stack. Values that nest it bounds itself.
constexpr int kMaxKeyParts = 16;

// A text that begins with a quote, without what is quoted.
std::string_view SkipQuoted(std::string_view rest) {
  const char quote = rest[0];
  const std::string_view triple = quote == '"' ? R"(""")" : "'''";
  const bool is_long = rest.starts_with(triple);
  rest.remove_prefix(is_long ? 3 : 1);
  while (!rest.empty()) {
    if (is_long ? rest.starts_with(triple) : rest[0] == quote) {
      rest.remove_prefix(is_long ? 3 : 1);
      // A long text may end with one or two quotes of its own.
      for (int i = 0; i < 2 && is_long && rest.starts_with(quote); ++i) rest.remove_prefix(1);
      return rest;
    }
    if (!is_long && rest[0] == '\n') return rest;  // a mistake, which the parser will tell
    const bool escapes = quote == '"' && rest[0] == '\\' && rest.size() > 1;
    rest.remove_prefix(escapes ? 2 : 1);
  }
  return rest;
}

// The line of the first key with more than kMaxKeyParts parts; 0 if there is none.
size_t LineOfLongKey(std::string_view text) {
  int dots = 0;
  for (std::string_view rest = text; !rest.empty();) {
    const char c = rest[0];
    if (c == '"' || c == '\'') {
      rest = SkipQuoted(rest);
      continue;
    }
    if (c == '#') {
      rest.remove_prefix(std::min(rest.find('\n'), rest.size()));
      continue;
    }
    const bool is_within_key = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' ||
                               c == '-' || c == '.' || c == ' ' || c == '\t';
    if (!is_within_key) dots = 0;
    if (c == '.' && ++dots == kMaxKeyParts) {
      return 1 + static_cast<size_t>(std::count(text.data(), rest.data(), '\n'));
    }
    rest.remove_prefix(1);
  }
  return 0;
}

}  // namespace

Result<toml::table> ParseToml(const std::string& text, const std::string& file) {
  if (const size_t line = LineOfLongKey(text); line != 0) {
    return Status(
        StatusCode::kInvalidArgument,
        fmt::format("{} line {}: a key has more than {} parts", file, line, kMaxKeyParts));
  }
  toml::parse_result parsed = toml::parse(text);
  if (parsed) return std::move(parsed).table();
  return Status(StatusCode::kInvalidArgument,
                fmt::format("{} line {}: {}", file, parsed.error().source().begin.line,
                            parsed.error().description()));
}

Result<toml::table> ReadTomlFile(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const std::string text,
                         ReadSmallFile(path, kMaxFileBytes, FileKinds::kAny));
  return ParseToml(text, path);
}

}  // namespace b4mrl

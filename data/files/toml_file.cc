#include "data/files/toml_file.h"

#include <fmt/format.h>

#include <utility>

#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

constexpr size_t kMaxFileBytes = 1 << 20;

}  // namespace

Result<toml::table> ParseToml(const std::string& text, const std::string& file) {
  toml::parse_result parsed = toml::parse(text);
  if (parsed) return std::move(parsed).table();
  return Status(StatusCode::kInvalidArgument,
                fmt::format("{} line {}: {}", file, parsed.error().source().begin.line,
                            parsed.error().description()));
}

Result<toml::table> ReadTomlFile(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(path, kMaxFileBytes));
  return ParseToml(text, path);
}

}  // namespace b4mrl

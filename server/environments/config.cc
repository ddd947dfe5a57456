#include "server/environments/config.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr int kMaxDepth = 8;

}  // namespace

Result<Config> ParseConfig(std::string_view text) {
  if (text.empty()) return Config::object();
  if (text.size() > limits::kMaxOpenRequestBytes) {
    return InvalidNumber("bytes of config", static_cast<double>(text.size()),
                         fmt::format("at most {}", limits::kMaxOpenRequestBytes));
  }
  bool too_deep = false;
  const auto watch_depth = [&too_deep](int depth, Config::parse_event_t, Config&) {
    too_deep = too_deep || depth > kMaxDepth;
    return !too_deep;
  };
  Config config = Config::parse(text, watch_depth, /*allow_exceptions=*/false);
  if (too_deep) return InvalidArgument("depth of config", "more", std::to_string(kMaxDepth));
  if (!config.is_object()) {
    return Status(StatusCode::kInvalidArgument, "config is not a JSON object");
  }
  return config;
}

}  // namespace b4mrl

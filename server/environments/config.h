// An environment's settings: a JSON object under the names that users know (Gymnasium's constructor
// arguments, highway-env's config). A value type; config_reader.h reads one. Code that only passes
// a Config on need not see the JSON library.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string_view>

#include "proto/base/status.h"

namespace b4mrl {

using Config = nlohmann::json;  // always an object

// "" is the empty object. Refuses text beyond limits::kMaxOpenRequestBytes, text that is no JSON
// object, and nesting deeper than 8.
Result<Config> ParseConfig(std::string_view text);

}  // namespace b4mrl

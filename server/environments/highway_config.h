// highway-env's configuration as this project takes it: JSON under the original's names, and the
// checked settings it becomes. highway.cc lists what is supported. Any thread.
#pragma once

#include "proto/base/status.h"
#include "server/environments/config.h"
#include "server/highway/settings.h"

namespace b4mrl {

// Checks what is given and fills in the rest: without `env_id` as highway-fast-v0 with 3 other
// cars, with it as that environment has it. The dictionaries `action` and `observation` replace the
// default ones whole, as in the original. Unknown keys, and values that would need what this
// simulator does not have, are errors that name the key.
Result<Config> CompleteHighwayConfig(const Config& config);

// `completed`: a result of CompleteHighwayConfig.
HighwaySettings ReadHighwaySettings(const Config& completed);

}  // namespace b4mrl

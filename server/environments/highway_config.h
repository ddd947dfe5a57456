// highway-env's configuration as this project takes it: JSON under highway-env's names, and the
// checked settings it becomes. highway.cc lists what is supported. Any thread.
#pragma once

#include "proto/base/status.h"
#include "server/environments/config.h"
#include "server/highway/settings.h"

namespace b4mrl {

// Checks the given settings and fills in the defaults of the environment `env_id`; without `env_id`
// those of highway-fast-v0 with 3 other cars. The dictionaries `action` and `observation` replace
// the default dictionaries whole, as in highway-env. Unknown keys, and values that this simulator
// does not support, are errors that name the key.
Result<Config> CompleteHighwayConfig(const Config& config);

// `completed`: a result of CompleteHighwayConfig.
HighwaySettings ReadHighwaySettings(const Config& completed);

}  // namespace b4mrl

// The version of MuJoCo, for experiment ids and snapshots. Any thread.
#pragma once

#include <string>

namespace b4mrl {

// Name and version of the loaded library: "MuJoCo 2.2.2". Other versions may give other numbers.
std::string EngineVersion();

}  // namespace b4mrl

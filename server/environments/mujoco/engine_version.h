// Any thread.
#pragma once

#include <string>

namespace b4mrl {

// The engine whose version decides the numbers: "MuJoCo 2.2.2".
std::string EngineVersion();

}  // namespace b4mrl

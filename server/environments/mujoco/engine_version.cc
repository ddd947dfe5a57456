#include "server/environments/mujoco/engine_version.h"

#include <fmt/format.h>
#include <mujoco/mujoco.h>

namespace b4mrl {

std::string EngineVersion() { return fmt::format("MuJoCo {}", mj_versionString()); }

}  // namespace b4mrl

#include "server/environments/mujoco/engine_version.h"

#include <fmt/format.h>
#include <mujoco/mujoco.h>

namespace b4mrl {

// Other versions compute other numbers: datasets, recordings and scores are of this one.
static_assert(mjVERSION_HEADER == 222, "MuJoCo's headers must be those of version 2.2.2");

std::string EngineVersion() { return fmt::format("MuJoCo {}", mj_versionString()); }

Status CheckEngineVersion() {
  if (mj_version() == mjVERSION_HEADER) return Status();
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("the library MuJoCo that was loaded has version {}, and this program "
                            "was compiled for {}; allowed: the library of its headers",
                            mj_version(), mjVERSION_HEADER));
}

}  // namespace b4mrl

#include "proto/base/version.h"

namespace b4mrl {

std::string_view ProjectVersion() { return B4MRL_VERSION; }

std::string_view LearnerArchitecture() { return B4MRL_ARCHITECTURE; }

}  // namespace b4mrl

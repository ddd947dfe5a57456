#include "proto/base/version.h"

namespace b4mrl {

std::string_view ProjectVersion() { return B4MRL_VERSION; }

}  // namespace b4mrl

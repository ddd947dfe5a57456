// What an Open says before any simulator is asked. Pure functions but for the drawn seed; any
// thread.
#pragma once

#include <string>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"

namespace b4mrl {

// Checks what needs no simulator and fills in what was left out.
Status CompleteOpen(const std::string& token, pb::OpenRequest* open);

// FILE.xml of a model=FILE.xml among the perturbations; "" if there is none.
std::string ModelFileOf(const pb::OpenRequest& open);

}  // namespace b4mrl

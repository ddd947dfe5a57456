// Checks of an Open that need no simulator. Pure functions but for the drawn seed; any thread.
#pragma once

#include <string>

#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"

namespace b4mrl {

// Checks token, lanes, modes and the size of what the client sent, and then fills in what the
// client left out: the seed, which is drawn, and the dtype of observations.
Status CompleteOpen(const std::string& token, pb::OpenRequest* open);

// The file that a perturbation model=FILE.xml names; "" if there is no such perturbation.
std::string ModelFileOf(const pb::OpenRequest& open);

}  // namespace b4mrl

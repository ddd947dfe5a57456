// An environment's specification as a protocol message. Any thread.
#pragma once

#include "proto/b4mrl.pb.h"
#include "proto/base/spec.h"

namespace b4mrl {

void FillEnvironmentInfo(const EnvironmentSpec& spec, pb::EnvironmentInfo* out);

}  // namespace b4mrl

// Converts lists of perturbations and corruptions to messages and back. Pure functions; any thread.
#pragma once

#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/spec.h"

namespace b4mrl {

using NamedArgumentMessages = google::protobuf::RepeatedPtrField<pb::NamedArgument>;

void AddNamedArguments(const std::vector<NamedArgument>& items, NamedArgumentMessages* out);
std::vector<NamedArgument> NamedArgumentsOf(const NamedArgumentMessages& messages);

}  // namespace b4mrl

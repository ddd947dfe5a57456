// Identifiers of Minari's datasets, which are also their folders' paths below Minari's root folder:
// "b4mrl/HalfCheetah/medium-v0" is a namespace of one or more parts, a name and a version.
// Pure functions; any thread.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

// OK for an id that Minari accepts and lists: parts of ASCII letters, digits, '-' and '_', joined
// by '/', none of them "data", and a version such as "-v0" at the end. kInvalidArgument.
Status CheckMinariId(std::string_view id);

// The namespaces of an id, outer before inner: "b4mrl", "b4mrl/HalfCheetah".
std::vector<std::string> MinariNamespaces(std::string_view id);

// What the rows of an exported dataset depend on.
struct ServedRows {
  std::string name;                        // full name of the dataset: "HalfCheetah/medium-v0"
  std::vector<NamedArgument> corruptions;  // in force
  uint64_t corruption_seed = 0;            // 0: the default, or no corruption draws numbers
  bool d4rl_transitions = false;
};

// The id of an exported dataset: "b4mrl/", its name, what its rows depend on beyond the name, and
// its version, "-v0" for a name without one. Characters that an id cannot have become '_', points
// 'p': "b4mrl/HalfCheetah/medium_obs-noise-0p05_seed-1-v0".
std::string MinariIdOf(const ServedRows& rows);

}  // namespace b4mrl

// Which environment a dataset belongs to. Pure functions; any thread.
#pragma once

#include <cstdint>
#include <string>

#include "data/columns/dataset.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

// The environment that a dataset's name belongs to, "HalfCheetah" for "HalfCheetah/medium" and
// "d4rl/halfcheetah-medium-v2"; "" if no known environment has that name.
std::string EnvironmentOfName(const std::string& name);

// The environment that a file names: "HalfCheetah" for "HalfCheetah" and for Gymnasium's id
// "HalfCheetah-v4"; the file's own text if it names no known environment.
std::string EnvironmentOfText(const std::string& text);

// The specification of `environment`, or one with unnamed dimensions if that is not a known
// environment. kFailedPrecondition when the sizes differ; `name` is the dataset's, for the message.
Result<EnvironmentSpec> SpecOfDataset(const std::string& name, const std::string& environment,
                                      uint32_t observation_size, uint32_t action_size);

// OK if the dataset may be used for the environment `wanted` ("" is any): if it was recorded in
// `environment` and that is the one wanted or, where `environment` is "", if its sizes fit. Names
// are compared because tasks may have equal sizes, as HalfCheetah and Walker2d have.
// kInvalidArgument; kUnknownName for an unknown `wanted`.
Status CheckEnvironment(const std::string& name, const std::string& environment,
                        const TransitionColumns& columns, const std::string& wanted);

}  // namespace b4mrl

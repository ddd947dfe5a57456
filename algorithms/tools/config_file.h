// `--config FILE.toml`: a file of options, equal to the same options given first on the command
// line.
//
//   algorithm = "td3-bc"        --algorithm td3-bc
//   updates = 100_000           --updates 100000
//   resume = true               --resume            (false: not resumed)
// Later options win, so the command line overrides the file. Only top-level keys with strings,
// numbers and booleans are allowed.
#pragma once

#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// Replaces `--config FILE` in `arguments` by the file's options. Errors: kIoError, kInvalidArgument
// with the file's line or key.
Result<std::vector<std::string>> ExpandConfigFile(std::vector<std::string> arguments);

}  // namespace b4mrl

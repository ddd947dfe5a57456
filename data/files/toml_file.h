// TOML files, read without exceptions.
//
// Whatever reads TOML includes this header instead of toml++'s own: a program in which one source
// compiles toml++ with exceptions and another without them crashes, as both define the same names.
// Pure functions; any thread.
#pragma once

#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include <string>

#include "proto/base/status.h"

namespace b4mrl {

// kInvalidArgument names the file, the line and the mistake; `file` is for the message.
Result<toml::table> ParseToml(const std::string& text, const std::string& file);
// Errors: as above, and those of ReadSmallFile (atomic_file.h) for files that cannot be read or
// have more than 1 MiB.
Result<toml::table> ReadTomlFile(const std::string& path);

}  // namespace b4mrl

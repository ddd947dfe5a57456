// The part of `b4mrl dataset import` that turns a Minari dataset into a file in D4RL's layout. One
// thread.
#pragma once

#include <string>

#include "client/client.h"
#include "proto/base/status.h"

namespace b4mrl {

// Writes the Minari dataset whose metadata.json is in `data_folder` to the new file `path`. Its
// environment is one of the client's daemon if the ids and the sizes are equal: "HalfCheetah" for
// Gymnasium's HalfCheetah-v2 to -v5. The file's recipe names Minari's id and Gymnasium's, and a
// line on stderr says, unless `quiet`, if the daemon's default version of the task is another one.
// Errors: those of minari_reader.h; kUnavailable after an interrupt.
Status ConvertMinari(const std::string& data_folder, const std::string& path, Client& client,
                     bool quiet);

}  // namespace b4mrl

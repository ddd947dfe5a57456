// Checks which files an MJCF file refers to before MuJoCo parses it. So a reference to a file
// outside the models folder is refused with its line, and also where the kernel cannot confine the
// process.
//
// Reads the file and all files that it includes. Since it parses XML, it is called in the sandbox.
#pragma once

#include <string>

#include "proto/base/status.h"

namespace b4mrl {

// OK when models_folder/file_name is well-formed MJCF, at most limits::kMaxModelFileBytes long,
// with at most limits::kMaxModelReferences references, and none of them (includes, meshes,
// textures, height fields, skins, folders) is absolute, goes upwards, or leads out of the folder
// over a symbolic link. Else kInvalidArgument with "FILE, line N".
Status ScanModelFile(const std::string& models_folder, const std::string& file_name);

}  // namespace b4mrl

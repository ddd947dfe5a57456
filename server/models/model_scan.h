// What an MJCF file refers to, before MuJoCo is let loose on it: a message with a line for every
// file that lies outside the models folder, and no dependence on what the kernel can confine.
//
// Reads the file and all that it includes. Still to be called in a sandbox: it parses XML.
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

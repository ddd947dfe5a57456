// Compiles a user's MJCF file to the binary model that simulators load. This header needs no type
// of MuJoCo. server/models/model_compiler.h runs CompileModelFile in a sandboxed process.
#pragma once

#include <string>
#include <string_view>

#include "proto/base/status.h"
#include "server/environments/list.h"

namespace b4mrl {

// Compiles the MJCF file at `path` and writes it to `output` in MuJoCo's binary format; returns its
// hash. Only for a sandboxed process that may be killed: the compiler has no bounds of its own, and
// an error leaves memory and perhaps a part of `output` behind. kInvalidArgument with the
// compiler's reason and line, or when the compilation, the model or the memory of one simulation is
// beyond limits::kMaxModelCompilerBytes, kMaxModelBytes or kMaxSimulationBytes, or its state beyond
// what lanes keep: no retry helps until the file changes.
Result<std::string> CompileModelFile(const std::string& path, const std::string& output);

// The bytes of a model's file, MJCF or compiled.
Result<std::string> ReadModelFile(const std::string& path);
// The hash of a compiled model's bytes: 128 bits in hexadecimal.
std::string HashOfModel(std::string_view bytes);

// The path of the compiled model with this hash in `folder`, and the CompiledModel at such a path.
std::string CompiledModelPath(const std::string& folder, const std::string& hash);
CompiledModel CompiledModelAt(const std::string& path);

}  // namespace b4mrl

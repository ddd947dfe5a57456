#include "server/environments/mujoco/compiled_model.h"

#include <fmt/format.h>
#include <mujoco/mujoco.h>
#include <xxhash.h>

#include <cerrno>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <new>
#include <string_view>
#include <utility>

#include "proto/base/limits.h"
#include "server/environments/mujoco/mujoco_guard.h"
#include "server/environments/mujoco/mujoco_model.h"

namespace b4mrl {
namespace {

// A lane keeps positions, velocities and the warm start, so a model must have no other state.
Status CheckState(const mjModel& model) {
  const auto refuse = [](const char* what, int count) {
    return InvalidArgument(what, std::to_string(count), "0: lanes do not keep them");
  };
  if (model.na != 0) return refuse("number of actuators' own states", model.na);
  if (model.nmocap != 0) return refuse("number of mocap bodies", model.nmocap);
  if (model.nuserdata != 0) return refuse("nuserdata", model.nuserdata);
  return Status();
}

Status CheckSizes(const mjModel& model) {
  B4MRL_ASSIGN_OR_RETURN(const MjDataPtr data, MakeMujocoData(model));
  const size_t bytes = BytesOf(*data);
  if (bytes <= limits::kMaxSimulationBytes) return Status();
  return Status(StatusCode::kInvalidArgument,
                fmt::format("a simulation of the model takes {} bytes, allowed: {}; lower njmax, "
                            "nconmax and nstack of <size>",
                            bytes, limits::kMaxSimulationBytes));
}

// MuJoCo's message on one line: "Schema violation: unrecognized attribute: 'sise', Element 'geom',
// line 31". For refused memory the limit is added.
Status Refusal(std::string_view message) {
  std::string line;
  for (const char c : message) {
    if (c != '\n') {
      line += c;
    } else if (!line.empty() && !line.ends_with(", ")) {
      line += ", ";
    }
  }
  if (line.ends_with(", ")) line.resize(line.size() - 2);
  if (line.find("allocate memory") != std::string::npos) {
    line += fmt::format("; a model is compiled within {} bytes", limits::kMaxModelCompilerBytes);
  }
  return Status(StatusCode::kInvalidArgument, std::move(line));
}

// mj_saveModel does not tell when it could not write everything, as on a full disk, so the file is
// compared with the model as it is saved to memory, whose end is not used. Returns the file's
// bytes.
Result<std::string> ReadSaved(const mjModel& model, size_t size, const std::string& path) {
  std::string saved(size, '\0');
  mj_saveModel(&model, nullptr, saved.data(), static_cast<int>(size));
  B4MRL_ASSIGN_OR_RETURN(std::string written, ReadModelFile(path));
  const bool is_whole = saved.starts_with(written) &&
                        saved.find_first_not_of('\0', written.size()) == std::string::npos;
  if (is_whole) return written;
  return Status(StatusCode::kIoError,
                fmt::format("cannot write {}: {} bytes of it are there", path, written.size()));
}

}  // namespace

Result<std::string> CompileModelFile(const std::string& path, const std::string& output) {
  InstallMujocoHandlers();
  mjModel* compiled = nullptr;
  char error[1000] = "";
  try {
    const bool finished =
        RunGuarded([&] { compiled = mj_loadXML(path.c_str(), nullptr, error, sizeof(error)); });
    if (!finished) return Refusal(LastMujocoError());
  } catch (const std::bad_alloc&) {  // the compiler is C++ behind a C interface
    return Refusal("cannot allocate memory");
  } catch (const std::exception& exception) {
    return Refusal(exception.what());
  }
  if (compiled == nullptr) return Refusal(error);
  const MjModelPtr model(compiled);
  B4MRL_RETURN_IF_ERROR(CheckState(*model));
  B4MRL_RETURN_IF_ERROR(CheckSizes(*model));
  const auto size = static_cast<size_t>(mj_sizeModel(model.get()));
  if (size > limits::kMaxModelBytes) {
    return Status(
        StatusCode::kInvalidArgument,
        fmt::format("the compiled model has {} bytes, allowed: {}", size, limits::kMaxModelBytes));
  }
  mj_saveModel(model.get(), output.c_str(), nullptr, 0);
  B4MRL_ASSIGN_OR_RETURN(const std::string written, ReadSaved(*model, size, output));
  return HashOfModel(written);
}

Result<std::string> ReadModelFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return IoError("open", path, errno);
  return std::string(std::istreambuf_iterator<char>(file), {});
}

std::string HashOfModel(std::string_view bytes) {
  const XXH128_hash_t hash = XXH3_128bits(bytes.data(), bytes.size());
  return fmt::format("{:016x}{:016x}", hash.high64, hash.low64);
}

std::string CompiledModelPath(const std::string& folder, const std::string& hash) {
  return fmt::format("{}/{}.mjb", folder, hash);
}

CompiledModel CompiledModelAt(const std::string& path) {
  return {path, std::filesystem::path(path).stem()};
}

}  // namespace b4mrl

#include "server/environments/mujoco/mujoco_model.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <string_view>
#include <vector>

#include "server/environments/mujoco/compiled_model.h"
#include "server/environments/mujoco/engine_version.h"
#include "server/environments/mujoco/mujoco_guard.h"
#include "server/environments/mujoco/own_models.h"

namespace b4mrl {
namespace {

constexpr size_t kMessageBytes = 1000;

struct FilesDeleter {
  void operator()(mjVFS* files) const {
    mj_deleteVFS(files);
    delete files;
  }
};
using FilesPtr = std::unique_ptr<mjVFS, FilesDeleter>;

// A file system of one file, for MuJoCo to read it from memory.
Result<FilesPtr> InMemory(const std::string& name, std::string_view bytes) {
  FilesPtr files(new mjVFS);  // of megabytes
  mj_defaultVFS(files.get());
  if (mj_makeEmptyFileVFS(files.get(), name.c_str(), static_cast<int>(bytes.size())) != 0) {
    return Status(StatusCode::kUnavailable, "no memory for a model's file");
  }
  std::memcpy(files->filedata[mj_findFileVFS(files.get(), name.c_str())], bytes.data(),
              bytes.size());
  return files;
}

// Compiles one of the models that the program holds.
Result<LoadedModel> CompileOwnModel(const std::string& file_name) {
  InstallMujocoHandlers();
  const std::string_view bytes = OwnModel(file_name);
  if (bytes.empty()) {
    return Status(StatusCode::kInternal, fmt::format("the program has no model {}", file_name));
  }
  B4MRL_ASSIGN_OR_RETURN(const FilesPtr files, InMemory(file_name, bytes));
  char error[kMessageBytes] = "";
  MjModelPtr model(mj_loadXML(file_name.c_str(), files.get(), error, sizeof(error)));
  if (model == nullptr) {
    return Status(StatusCode::kDataLoss, fmt::format("model {}: {}", file_name, error));
  }
  const uint64_t hash = XXH3_64bits(bytes.data(), bytes.size());
  return LoadedModel{std::move(model), fmt::format("{}:{:016x}", file_name, hash), "", {}, {}};
}

Result<MjModelPtr> Copy(const mjModel& model) {
  MjModelPtr copy(mj_copyModel(nullptr, &model));
  if (copy != nullptr) return copy;
  return Status(StatusCode::kUnavailable, "no memory for a model's copy");
}

// A copy of the task's own model, which is never read from a folder of users' models.
Result<LoadedModel> LoadOwnModel(const std::string& file_name) {
  static std::mutex mutex;
  static std::map<std::string, LoadedModel>* compiled = new std::map<std::string, LoadedModel>;
  const std::lock_guard lock(mutex);
  auto it = compiled->find(file_name);
  if (it == compiled->end()) {
    B4MRL_ASSIGN_OR_RETURN(LoadedModel fresh, CompileOwnModel(file_name));
    it = compiled->emplace(file_name, std::move(fresh)).first;
  }
  B4MRL_ASSIGN_OR_RETURN(MjModelPtr copy, Copy(*it->second.model));
  return LoadedModel{std::move(copy), it->second.identity, "", {}, {}};
}

// The compiled copy of a user's model.
Result<LoadedModel> LoadCompiledModel(const CompiledModel& compiled, const std::string& file_name) {
  if (compiled.path.empty()) {
    return Status(StatusCode::kUnsupported,
                  fmt::format("model={}: only a daemon compiles models of users", file_name));
  }
  B4MRL_ASSIGN_OR_RETURN(const std::string bytes, ReadModelFile(compiled.path));
  if (HashOfModel(bytes) != compiled.hash) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("the compiled copy of {} has other contents than it had", file_name));
  }
  InstallMujocoHandlers();
  // From these bytes, since others may replace the file, or remove it to make room.
  constexpr char kName[] = "compiled.mjb";
  B4MRL_ASSIGN_OR_RETURN(const FilesPtr files, InMemory(kName, bytes));
  mjModel* model = nullptr;
  const bool loaded = RunGuarded([&] { model = mj_loadModel(kName, files.get()); });
  if (!loaded || model == nullptr) {
    return Status(
        StatusCode::kDataLoss,
        fmt::format("the compiled copy of {} cannot be loaded ({})", file_name, EngineVersion()));
  }
  return LoadedModel{
      MjModelPtr(model), fmt::format("{}:{}", file_name, compiled.hash), file_name, {}, {}};
}

const char* JointTypeName(int type) {
  switch (type) {
    case mjJNT_FREE:
      return "free";
    case mjJNT_BALL:
      return "ball";
    case mjJNT_SLIDE:
      return "slide";
    default:
      return "hinge";
  }
}

// Observations and actions count joints and motors, and know no names. So where a user's model has
// the joints of the task's own by name, each must stand where the own one does, and a motor of a
// joint must turn the one that the own motor turns.
Status CheckOrder(const mjModel& own, const mjModel& model, const std::string& file_name) {
  const auto names_of = [](const mjModel& of) {
    std::vector<std::string> names;
    for (int i = 0; i < of.njnt; ++i) {
      const char* name = mj_id2name(&of, mjOBJ_JOINT, i);
      names.emplace_back(name == nullptr ? "" : name);
    }
    return names;
  };
  const std::vector<std::string> wanted = names_of(own), names = names_of(model);
  if (!std::is_permutation(names.begin(), names.end(), wanted.begin())) return Status();
  for (size_t i = 0; i < wanted.size(); ++i) {
    if (names[i] == wanted[i]) continue;
    return InvalidArgument(fmt::format("joint {} of {}", i, file_name), names[i], wanted[i]);
  }
  for (int i = 0; i < own.nu; ++i) {
    if (own.actuator_trntype[i] != mjTRN_JOINT) continue;
    const int type = model.actuator_trntype[i];
    const auto joint = static_cast<size_t>(model.actuator_trnid[2 * i]);
    const auto needed = static_cast<size_t>(own.actuator_trnid[2 * i]);
    if ((type != mjTRN_JOINT && type != mjTRN_JOINTINPARENT) || joint == needed) continue;
    return InvalidArgument(fmt::format("joint of actuator {} of {}", i, file_name), wanted[joint],
                           wanted[needed]);
  }
  return Status();
}

// Checks what observations, actions and rewards rely on; a user's model may differ in all else.
Status CheckFits(const mjModel& own, const mjModel& model, const std::string& file_name) {
  const auto number_of = [&](const char* what) {
    return fmt::format("number of {} of {}", what, file_name);
  };
  if (model.njnt != own.njnt) {
    return InvalidArgument(number_of("joints"), std::to_string(model.njnt),
                           std::to_string(own.njnt));
  }
  if (model.nu != own.nu) {
    return InvalidArgument(number_of("actuators"), std::to_string(model.nu),
                           std::to_string(own.nu));
  }
  for (int i = 0; i < own.njnt; ++i) {
    if (model.jnt_type[i] == own.jnt_type[i]) continue;
    return InvalidArgument(fmt::format("type of joint {} of {}", i, file_name),
                           JointTypeName(model.jnt_type[i]), JointTypeName(own.jnt_type[i]));
  }
  if (model.opt.timestep != own.opt.timestep) {
    return InvalidArgument(fmt::format("timestep of {}", file_name),
                           fmt::format("{} s", model.opt.timestep),
                           fmt::format("{} s, which the task's step is made of", own.opt.timestep));
  }
  return CheckOrder(own, model, file_name);
}

}  // namespace

Result<LoadedModel> LoadMujocoModel(const EnvironmentSetup& setup, const std::string& file_name,
                                    const std::function<void(mjModel*)>& adapt) {
  B4MRL_ASSIGN_OR_RETURN(LoadedModel loaded, LoadOwnModel(file_name));
  if (!setup.users_model.empty()) {
    B4MRL_ASSIGN_OR_RETURN(LoadedModel other,
                           LoadCompiledModel(setup.compiled_model, setup.users_model));
    B4MRL_RETURN_IF_ERROR(CheckFits(*loaded.model, *other.model, setup.users_model));
    loaded = std::move(other);
  } else if (adapt) {
    adapt(loaded.model.get());
  }
  if (setup.parameters.empty()) {
    B4MRL_RETURN_IF_ERROR(setup.change_model({}, loaded.model.get()));
  } else {
    loaded.change_copy = setup.change_model;
  }
  return loaded;
}

Status CheckModelShape(const LoadedModel& loaded, const char* own_file, const ModelShape& needed) {
  const mjModel& model = *loaded.model;
  if (model.nq == needed.positions && model.nv == needed.velocities && model.nu == needed.motors &&
      model.opt.timestep == needed.timestep &&
      (needed.bodies == 0 || model.nbody == needed.bodies)) {
    return Status();
  }
  const bool is_own = loaded.users_file.empty();
  return Status(
      is_own ? StatusCode::kDataLoss : StatusCode::kInvalidArgument,
      fmt::format("{} has {} coordinates, {} velocities, {} motors, {} bodies and a timestep of "
                  "{} s, needed: {}, {}, {}, {} and {} s",
                  is_own ? own_file : loaded.users_file, model.nq, model.nv, model.nu, model.nbody,
                  model.opt.timestep, needed.positions, needed.velocities, needed.motors,
                  needed.bodies == 0 ? "any" : std::to_string(needed.bodies), needed.timestep));
}

Result<MjDataPtr> MakeMujocoData(const mjModel& model) {
  mjData* data = nullptr;
  const bool made = RunGuarded([&] { data = mj_makeData(&model); });
  if (!made || data == nullptr) {
    return Status(StatusCode::kUnavailable, "no memory for another simulator");
  }
  return MjDataPtr(data);
}

size_t BytesOf(const mjModel& model) { return static_cast<size_t>(mj_sizeModel(&model)); }

size_t BytesOf(const mjData& data) {
  return static_cast<size_t>(data.nbuffer) + static_cast<size_t>(data.nstack) * sizeof(mjtNum);
}

Result<MujocoScratch> MujocoScratch::Create(const LoadedModel& loaded) {
  MjModelPtr own;
  if (loaded.change_copy) {
    B4MRL_ASSIGN_OR_RETURN(own, Copy(*loaded.model));
  }
  B4MRL_ASSIGN_OR_RETURN(MjDataPtr data, MakeMujocoData(*loaded.model));
  return MujocoScratch(loaded, std::move(own), std::move(data));
}

Status MujocoScratch::SetParameters(std::span<const double> parameters) {
  if (own_ == nullptr) return Status();
  mj_copyModel(own_.get(), loaded_->model.get());  // overwrites own_ in place, 3 us
  B4MRL_RETURN_IF_ERROR(loaded_->change_copy(parameters, own_.get()));
  pairs_ = ListCollisionPairs(own_.get());
  return Status();
}

}  // namespace b4mrl

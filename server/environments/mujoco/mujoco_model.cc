#include "server/environments/mujoco/mujoco_model.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <cerrno>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>

#include "server/environments/mujoco/compiled_model.h"
#include "server/environments/mujoco/engine_version.h"
#include "server/environments/mujoco/mujoco_guard.h"

namespace b4mrl {
namespace {

constexpr size_t kMessageBytes = 1000;

Result<std::string> ReadFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return IoError("open", path, errno);
  return std::string(std::istreambuf_iterator<char>(file), {});
}

Result<LoadedModel> Compile(const std::string& path, const std::string& file_name) {
  InstallMujocoHandlers();
  auto bytes = ReadFile(path);
  if (!bytes.ok()) return bytes.status();
  char error[kMessageBytes] = "";
  MjModelPtr model(mj_loadXML(path.c_str(), nullptr, error, sizeof(error)));
  if (model == nullptr) {
    return Status(StatusCode::kDataLoss, fmt::format("model {}: {}", path, error));
  }
  const uint64_t hash = XXH3_64bits(bytes->data(), bytes->size());
  return LoadedModel{std::move(model), fmt::format("{}:{:016x}", file_name, hash), "", {}};
}

// A copy of the task's own model, which no folder of users has a say in.
Result<LoadedModel> LoadOwnModel(const std::string& file_name) {
  static std::mutex mutex;
  static std::map<std::string, LoadedModel>* compiled = new std::map<std::string, LoadedModel>;
  const std::lock_guard lock(mutex);
  auto it = compiled->find(file_name);
  if (it == compiled->end()) {
    B4MRL_ASSIGN_OR_RETURN(LoadedModel fresh,
                           Compile(DefaultModelsFolder() + "/" + file_name, file_name));
    it = compiled->emplace(file_name, std::move(fresh)).first;
  }
  LoadedModel copy{
      MjModelPtr(mj_copyModel(nullptr, it->second.model.get())), it->second.identity, "", {}};
  if (copy.model != nullptr) return copy;
  return Status(StatusCode::kUnavailable, "no memory for a model's copy");
}

// The compiled copy of a user's model.
Result<LoadedModel> LoadCompiledModel(const CompiledModel& compiled, const std::string& file_name) {
  if (compiled.path.empty()) {
    return Status(StatusCode::kUnsupported,
                  fmt::format("model={}: only a daemon compiles models of users", file_name));
  }
  B4MRL_ASSIGN_OR_RETURN(const std::string hash, HashOfModelFile(compiled.path));
  if (hash != compiled.hash) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("the compiled copy of {} has other contents than it had", file_name));
  }
  InstallMujocoHandlers();
  struct Call {
    const char* path;
    mjModel* model;
  } call{compiled.path.c_str(), nullptr};
  const bool loaded = RunGuarded(
      [](void* argument) {
        auto* c = static_cast<Call*>(argument);
        c->model = mj_loadModel(c->path, nullptr);
      },
      &call);
  if (!loaded || call.model == nullptr) {
    return Status(
        StatusCode::kDataLoss,
        fmt::format("the compiled copy of {} cannot be loaded ({})", file_name, EngineVersion()));
  }
  return LoadedModel{
      MjModelPtr(call.model), fmt::format("{}:{}", file_name, compiled.hash), file_name, {}};
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

// Observations, actions and rewards count on these; what else a model holds is its own affair.
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
  return Status();
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
  B4MRL_RETURN_IF_ERROR(setup.change_model(loaded.model.get()));
  return loaded;
}

Result<MjDataPtr> MakeMujocoData(const mjModel& model) {
  struct Call {
    const mjModel* model;
    mjData* data;
  } call{&model, nullptr};
  const bool made = RunGuarded(
      [](void* argument) {
        auto* c = static_cast<Call*>(argument);
        c->data = mj_makeData(c->model);
      },
      &call);
  if (!made || call.data == nullptr) {
    return Status(StatusCode::kUnavailable, "no memory for another simulator");
  }
  return MjDataPtr(call.data);
}

}  // namespace b4mrl

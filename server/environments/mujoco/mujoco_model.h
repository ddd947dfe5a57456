// Compiled MuJoCo models: the tasks' own, the user's in their place, and their perturbed copies.
//
// A task's own MJCF is compiled once per process. A user's is never parsed here: a sandboxed
// process compiles it (CompileModelFile, called by server/models/model_compiler.cc) and everybody
// else loads the compiled copy, whose content names it. Any thread.
#pragma once

#include <mujoco/mujoco.h>

#include <functional>
#include <memory>
#include <string>

#include "proto/base/status.h"
#include "server/environments/list.h"
#include "server/environments/mujoco/collision_pairs.h"

namespace b4mrl {

struct MjModelDeleter {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct MjDataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using MjModelPtr = std::unique_ptr<mjModel, MjModelDeleter>;
using MjDataPtr = std::unique_ptr<mjData, MjDataDeleter>;

// A compiled model with all perturbations applied, and the hash of its content.
struct LoadedModel {
  MjModelPtr model;
  std::string identity;    // "half_cheetah.xml:<64-bit hash of the file, hexadecimal>"
  std::string users_file;  // in place of the task's own; "" for that
  CollisionPairs pairs;    // once listed: memory of the model's
};

// The task's own model is that file of DefaultModelsFolder(), compiled on first use and kept until
// the process ends, so that a later change of the file has no effect. The task may `adapt` it. A
// user's model replaces it (setup.users_model), and must have the same joints, motors and timestep.
// Then the perturbations apply (setup.change_model). kIoError or kDataLoss when a file
// cannot be read or compiled, kInvalidArgument when the user's model does not fit the task.
Result<LoadedModel> LoadMujocoModel(const EnvironmentSetup& setup, const std::string& file_name,
                                    const std::function<void(mjModel*)>& adapt = {});

// mj_makeData that answers refused memory with kUnavailable.
Result<MjDataPtr> MakeMujocoData(const mjModel& model);

}  // namespace b4mrl

// Compiled MuJoCo models: the tasks' own, the user's in their place, and their perturbed copies.
//
// A task's own MJCF is compiled once per process. A user's is never parsed here: a sandboxed
// process compiles it (CompileModelFile, called by server/models/model_compiler.cc) and everybody
// else loads the compiled copy, whose content names it. Any thread.
#pragma once

#include <mujoco/mujoco.h>

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>

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
  // Where perturbations draw numbers anew for each episode, `model` is without any perturbation and
  // without listed pairs, and this applies them to a copy: EnvironmentSetup::change_model.
  std::function<Status(std::span<const double> parameters, mjModel*)> change_copy;
};

// The arrays that a task's code expects of its model.
struct ModelShape {
  int positions;
  int velocities;
  int motors;
  double timestep;  // s
  int bodies = 0;   // with the world; 0: any number
};

// kDataLoss if a task's own model does not have the shape, kInvalidArgument if a user's has not.
Status CheckModelShape(const LoadedModel& loaded, const char* own_file, const ModelShape& needed);

// The task's own model is that file of DefaultModelsFolder(), compiled on first use and kept until
// the process ends, so that a later change of the file has no effect. The task may `adapt` it. A
// user's model replaces it (setup.users_model), and must have the same joints, motors and timestep.
// Then the perturbations apply (setup.change_model), unless they draw numbers anew for each
// episode. kIoError or kDataLoss when a file cannot be read or compiled, kInvalidArgument when the
// user's model does not fit the task.
Result<LoadedModel> LoadMujocoModel(const EnvironmentSetup& setup, const std::string& file_name,
                                    const std::function<void(mjModel*)>& adapt = {});

// mj_makeData that answers refused memory with kUnavailable.
Result<MjDataPtr> MakeMujocoData(const mjModel& model);

// What one Environment simulates with: an mjData, and the task's shared model or, where
// perturbations draw numbers anew for each episode, a copy of its own. Belongs to one thread.
class MujocoScratch {
 public:
  // `loaded` outlives the object. kUnavailable where memory is refused.
  static Result<MujocoScratch> Create(const LoadedModel& loaded);

  // Both stay where they are for the object's life.
  const mjModel& model() const { return own_ == nullptr ? *loaded_->model : *own_; }
  mjData* data() const { return data_.get(); }

  // Makes the copy equal, bit by bit, to a model that was loaded under fixed numbers of the values
  // of `parameters`. Without such numbers there is nothing to do.
  Status SetParameters(std::span<const double> parameters);

 private:
  MujocoScratch(const LoadedModel& loaded, MjModelPtr own, MjDataPtr data)
      : loaded_(&loaded), own_(std::move(own)), data_(std::move(data)) {}

  const LoadedModel* loaded_;
  MjModelPtr own_;
  CollisionPairs pairs_;  // memory of own_
  MjDataPtr data_;
};

}  // namespace b4mrl

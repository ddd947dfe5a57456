// Compiled MuJoCo models: the tasks' own, users' models in their place, and perturbed copies.
//
// A task's own MJCF is a part of the program, compiled once per process. A user's MJCF is never
// parsed here: a sandboxed process compiles it (CompileModelFile, called by
// server/models/model_compiler.cc), and all others load the compiled copy, a file named by the hash
// of its content. Any thread.
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
  std::string users_file;  // user's MJCF in place of the task's own; "" without one
  CollisionPairs pairs;    // if pairs are listed: memory that `model` uses
  // EnvironmentSetup::change_model, set only if perturbations draw numbers anew for each episode.
  // `model` then has neither perturbations nor listed pairs; this function perturbs a copy of it.
  std::function<Status(std::span<const double> parameters, mjModel*)> change_copy;
};

// The array sizes and the timestep that a task's code expects of its model.
struct ModelShape {
  int positions;
  int velocities;
  int motors;
  double timestep;  // s
  int bodies = 0;   // the world included; 0: any number
};

// OK if the model has the shape `needed`; else kDataLoss for a task's own model and
// kInvalidArgument for a user's.
Status CheckModelShape(const LoadedModel& loaded, const char* own_file, const ModelShape& needed);

// Loads a user's model (setup.users_model), which must have the joints, motors and timestep of the
// task's own, in its order if it has the own one's names, or else the task's own, changed by
// `adapt`. Then the perturbations apply (setup.change_model), unless they draw numbers anew for
// each episode. The task's own model is OwnModel(file_name), compiled on first use and kept until
// the process ends. kIoError or kDataLoss when a file cannot be read or compiled, kInvalidArgument
// when the user's model does not fit the task, kInternal if the program has no such model.
Result<LoadedModel> LoadMujocoModel(const EnvironmentSetup& setup, const std::string& file_name,
                                    const std::function<void(mjModel*)>& adapt = {});

// Calls mj_makeData; kUnavailable where memory is refused.
Result<MjDataPtr> MakeMujocoData(const mjModel& model);

// Bytes of memory of a model, and those that an mjData may come to take. MuJoCo touches the pages
// of an mjData's stack as a simulation needs them.
size_t BytesOf(const mjModel& model);
size_t BytesOf(const mjData& data);

// The MuJoCo objects of one Environment: an mjData, and the task's shared model or, where
// perturbations draw numbers anew for each episode, a private copy of that model. Belongs to one
// thread.
class MujocoScratch {
 public:
  // `loaded` outlives the object. kUnavailable where memory is refused.
  static Result<MujocoScratch> Create(const LoadedModel& loaded);

  // Model and data keep their addresses for the object's life.
  const mjModel& model() const { return own_ == nullptr ? *loaded_->model : *own_; }
  mjData* data() const { return data_.get(); }
  // Bytes of memory that the objects may come to take.
  size_t memory_bytes() const { return BytesOf(*data_) + (own_ == nullptr ? 0 : BytesOf(*own_)); }

  // Makes the private copy equal, bit by bit, to a model that was loaded with `parameters` as fixed
  // numbers. Without a private copy this does nothing.
  Status SetParameters(std::span<const double> parameters);

 private:
  MujocoScratch(const LoadedModel& loaded, MjModelPtr own, MjDataPtr data)
      : loaded_(&loaded), own_(std::move(own)), data_(std::move(data)) {}

  const LoadedModel* loaded_;
  MjModelPtr own_;
  CollisionPairs pairs_;  // memory that own_ uses
  MjDataPtr data_;
};

}  // namespace b4mrl

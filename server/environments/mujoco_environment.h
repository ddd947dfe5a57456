// What the MuJoCo tasks share: loading a model once per process, its perturbed copies, and an
// Environment whose state is time, qpos, qvel and the solver's warm start. A task adds its
// observation, reward and termination.
//
// A control step writes the action into ctrl, calls mj_step frame_skip times and nothing else: no
// mj_forward stands between steps, because it would change the warm start. LoadState copies the
// four arrays and calls nothing either; mj_step computes all else from them, with equal bits (tests
// compare with recorded trajectories). Actuators clip their own copy of the action.
#pragma once

#include <mujoco/mujoco.h>

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/base/status.h"
#include "server/environments/environment.h"
#include "server/environments/list.h"

namespace b4mrl {

struct MjModelDeleter {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct MjDataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using MjModelPtr = std::unique_ptr<mjModel, MjModelDeleter>;
using MjDataPtr = std::unique_ptr<mjData, MjDataDeleter>;

// A compiled model with all perturbations applied, and the hash of its file.
struct LoadedModel {
  MjModelPtr model;
  std::string identity;  // "half_cheetah.xml:<64-bit hash of the file, hexadecimal>"
};

// Compiles models_folder/file_name on first use (kept until the process ends, so a later change of
// the file has no effect), copies it and applies the perturbations. kIoError or kDataLoss when the
// file cannot be read or compiled.
Result<LoadedModel> LoadMujocoModel(const EnvironmentSetup& setup, const std::string& file_name);

// mj_makeData that answers refused memory with kUnavailable.
Result<MjDataPtr> MakeMujocoData(const mjModel& model);

class MujocoEnvironment : public Environment {
 public:
  size_t state_size() const override;
  StepResult Step(std::span<const double> action) override;
  Status Reset(Rng& rng) override;
  void SaveState(std::span<double> state) const override;
  void LoadState(std::span<const double> state) override;
  Status SetFromObservation(std::span<const double> observation) override;
  NamedState GetNamedState() const override;
  Status SetNamedState(const NamedState& state) override;
  QueryResult Query(std::span<const double> observation, std::span<const double> action,
                    std::span<double> next_observation) override;

 protected:
  // `model` outlives the object; `data` belongs to it.
  MujocoEnvironment(const mjModel& model, MjDataPtr data, int frame_skip);

  const mjModel& model() const { return model_; }
  const mjData& data() const { return *data_; }

  // Fills qpos and qvel, which hold the model's initial values, with an episode's start.
  virtual void DrawInitialState(Rng& rng, std::span<double> qpos, std::span<double> qvel) const = 0;
  // The state that `observation` describes; both spans hold zeros.
  virtual void StateFromObservation(std::span<const double> observation, std::span<double> qpos,
                                    std::span<double> qvel) const = 0;
  // Remembered from before a step for its reward, such as the root's x.
  virtual double Progress() const = 0;
  // Reward and termination of the step that has just been simulated.
  virtual StepResult Judge(double progress_before, std::span<const double> action) const = 0;

 private:
  std::span<double> qpos() { return {data_->qpos, static_cast<size_t>(model_.nq)}; }
  std::span<double> qvel() { return {data_->qvel, static_cast<size_t>(model_.nv)}; }
  // mj_step frame_skip times; false after an error or a warning, with the data reset.
  bool Simulate(std::span<const double> action);
  // mj_forward; the same.
  bool Forward();
  bool Guarded(void (*function)(void*));

  const mjModel& model_;
  MjDataPtr data_;
  int frame_skip_;
};

}  // namespace b4mrl

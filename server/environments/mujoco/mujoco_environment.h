// What the MuJoCo tasks share beside their models (mujoco_model.h): an Environment whose state is
// time, qpos, qvel, the warm start of the solver and whatever else a task names. A task adds its
// observation, reward and termination (locomotion.h).
//
// A control step writes the action into ctrl, calls mj_step frame_skip times and no mj_forward:
// that would change the warm start. LoadState copies numbers and calls nothing either; mj_step
// computes all else from them, with equal bits (tests compare with recorded trajectories).
// Actuators clip their own copy of the action.
//
// Under RK4 the arrays that MuJoCo derives from positions and velocities (xipos, cinert, cvel,
// cfrc_ext) are not those of the state that mj_step leaves, but of the last stage before it. A task
// that reads them between steps keeps them as parts of its state.
#pragma once

#include <mujoco/mujoco.h>

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/base/status.h"
#include "server/environments/environment.h"
#include "server/environments/mujoco/mujoco_model.h"

namespace b4mrl {

class MujocoEnvironment : public Environment {
 public:
  size_t state_size() const override;
  StepResult Step(std::span<const double> action) override;
  Status Reset(Rng& rng) override;
  void SaveState(std::span<double> state) const override;
  void LoadState(std::span<const double> state) override;
  NamedState GetNamedState() const override;
  Status SetNamedState(const NamedState& state) override;
  QueryResult Query(std::span<const double> observation, std::span<const double> action,
                    std::span<double> next_observation) override;
  Status Draw(Canvas& canvas) override;

 protected:
  MujocoEnvironment(MujocoScratch scratch, int frame_skip);

  const mjModel& model() const { return model_; }
  const mjData& data() const { return *data_; }
  // Simulated seconds of one control step.
  double step_seconds() const { return model_.opt.timestep * frame_skip_; }

  // Adds numbers of the task's own to the state, saved and loaded from where they are; they must
  // not move. Only in a constructor.
  void AddStatePart(const char* name, std::span<double> values);
  mjData* mutable_data() { return data_; }

  // Fills qpos and qvel, which hold the model's initial values, with an episode's start.
  virtual void DrawInitialState(Rng& rng, std::span<double> qpos, std::span<double> qvel) const = 0;
  // The state that `observation` describes; both spans hold zeros.
  virtual void StateFromObservation(std::span<const double> observation, std::span<double> qpos,
                                    std::span<double> qvel) const = 0;
  // Reward and termination of the step that has just been simulated.
  virtual StepResult Judge(std::span<const double> action) = 0;

  // Hooks that run under MuJoCo's error guard: they own no object with a destructor.
  // Before a step: remember what the reward compares with.
  virtual void BeforeStep() {}
  // After the last mj_step of a step: what else the original computes then.
  virtual void AfterStep() {}
  // A state was set and mj_forward has derived the rest from it.
  virtual void AfterForward() {}
  // A query has set qpos, qvel and a warm start of 0, and nothing is derived from them yet.
  virtual void BeforeQuery() {}

 private:
  struct StatePart {
    const char* name;
    std::span<double> values;
    bool required;  // by SetNamedState: what mj_forward starts from
  };
  std::span<double> qpos() { return {data_->qpos, static_cast<size_t>(model_.nq)}; }
  std::span<double> qvel() { return {data_->qvel, static_cast<size_t>(model_.nv)}; }
  // A control step up to the task's judgement; false after an error or a warning, with the data
  // reset.
  bool Simulate(std::span<const double> action);
  // mj_forward; the same.
  bool Forward();
  bool Guarded(void (*function)(void*));

  Status ApplyParameters(std::span<const double> parameters) final {
    return scratch_.SetParameters(parameters);
  }

  MujocoScratch scratch_;
  const mjModel& model_;  // scratch_'s
  mjData* data_;          // scratch_'s
  int frame_skip_;
  std::vector<StatePart> parts_;
};

}  // namespace b4mrl

// The base class of the MuJoCo tasks: an Environment whose state is time, qpos, qvel, the solver's
// warm start (qacc_warmstart) and the parts that a task adds. A task brings its model
// (mujoco_model.h), observation, reward and termination (locomotion.h).
//
// A control step writes the action into ctrl and calls mj_step frame_skip times. It never calls
// mj_forward, which would change the warm start, and neither does LoadState, which only copies the
// state: mj_step computes all else, with equal bits (tests compare with recorded trajectories).
// Actuators clip their own copy of the action.
//
// With the RK4 integrator, the arrays that MuJoCo derives from positions and velocities (xipos,
// cinert, cvel, cfrc_ext) belong after mj_step to the last Runge-Kutta stage, not to the new state.
// A task that reads these arrays between steps keeps them as parts of its state.
#pragma once

#include <mujoco/mujoco.h>

#include <span>
#include <vector>

#include "proto/base/status.h"
#include "server/environments/environment.h"
#include "server/environments/mujoco/mujoco_model.h"

namespace b4mrl {

class MujocoEnvironment : public Environment {
 public:
  size_t state_size() const override;
  size_t memory_bytes() const override { return scratch_.memory_bytes(); }
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

  // Adds the task's own numbers `values` to the state. `values` is read and written in place and
  // must not move. Only a constructor calls this.
  void AddStatePart(const char* name, std::span<double> values);
  mjData* mutable_data() { return data_; }

  // Writes an episode's start state over qpos and qvel, which hold the model's initial values.
  virtual void DrawInitialState(Rng& rng, std::span<double> qpos, std::span<double> qvel) const = 0;
  // Writes the state that `observation` describes: all of qvel, and what is known of qpos, which
  // holds zeros.
  virtual void StateFromObservation(std::span<const double> observation, std::span<double> qpos,
                                    std::span<double> qvel) const = 0;
  // Reward and termination of the step that has just been simulated.
  virtual StepResult Judge(std::span<const double> action) = 0;

  // The four hooks run under MuJoCo's error guard and therefore own no object with a destructor.
  // Before a step's first mj_step: stores the values that the reward compares with.
  virtual void BeforeStep() {}
  // After a step's last mj_step: computes what Gymnasium's task computes there.
  virtual void AfterStep() {}
  // After a reset or SetNamedState, when mj_forward has derived all else from the state.
  virtual void AfterForward() {}
  // Before a query's step: qpos, qvel and a warm start of 0 are set, and nothing is derived from
  // them.
  virtual void BeforeQuery() {}

 private:
  struct StatePart {
    const char* name;
    std::span<double> values;
    bool required;  // in SetNamedState, because mj_forward starts from it
  };
  std::span<double> qpos() { return {data_->qpos, static_cast<size_t>(model_.nq)}; }
  std::span<double> qvel() { return {data_->qvel, static_cast<size_t>(model_.nv)}; }
  // The physics and hooks of a control step, without reward and termination. False after an error
  // or a warning of MuJoCo, which also resets *data_.
  bool Simulate(std::span<const double> action);
  // Calls mj_forward and AfterForward; fails as Simulate does.
  bool Forward();
  // Calls `function` under MuJoCo's error guard; fails as Simulate does.
  template <typename Function>
  bool Guarded(Function function);

  Status ApplyParameters(std::span<const double> parameters) final {
    return scratch_.SetParameters(parameters);
  }

  MujocoScratch scratch_;
  const mjModel& model_;  // scratch_.model()
  mjData* data_;          // scratch_.data()
  int frame_skip_;
  std::vector<StatePart> parts_;
};

}  // namespace b4mrl

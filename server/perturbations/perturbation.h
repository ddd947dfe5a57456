// Perturbations make a simulator differ from the real environment, or corrupt a dataset. Read this
// first; list.h has the table of all perturbations and the paper's presets.
//
// A Perturbation is immutable and stateless; what it must remember between steps (a queue of
// delayed actions) lies in the lane's record and is passed in. Random numbers are
// position-addressed: a draw depends on the DrawContext, the perturbation's name and its occurrence
// among equal names alone, so adding a perturbation changes no other's draws, and the same class
// gives the same kind of noise on a simulator and on a dataset. Any thread.
//
// A perturbation whose argument is one number (gravity=1.5) may take a range instead
// (gravity=0.5..2). Its number is then drawn anew for each episode of a lane and for each row of a
// query. These drawn numbers are the *parameters* of a PerturbationSet. They are a function of the
// DrawContext and therefore never stored; OnOptions and OnModel are called again whenever they
// change.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/rng.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"
#include "server/environments/config.h"

struct mjModel_;  // MuJoCo's mjModel; only model perturbations include its header

namespace b4mrl {

// The address of one row of random numbers.
struct DrawContext {
  enum class Kind {
    kEpisode,  // a simulator's step
    kQuery,    // a row of T_sim
    kDataset,  // row `minor` of a dataset's noise matrix
    // The next observation of an episode's last row; no row has it as its observation.
    kDatasetLastRow,
  };
  Kind kind = Kind::kEpisode;
  uint64_t seed = 0;   // the lane's, the query's or the corruption's
  uint64_t major = 0;  // episode, draw, or noise matrix (each dataset file has its own)
  // Step within the episode (0: after reset), row of the query, row of the dataset.
  uint64_t minor = 0;
};

// The number that a perturbation is given, or the range that it is drawn from.
struct NumberArgument {
  double low = 0;  // lower end of the range, or the number itself
  double high = 0;
  bool is_range = false;  // low..high
  bool whole = false;     // whole numbers only, both ends included

  // A number drawn uniformly between low and high: a function of the arguments. `purpose` is the
  // perturbation's name.
  double Draw(const DrawContext& context, std::string_view purpose) const;
  // "1.5" or "0.5..2", in the shortest exact form.
  std::string ToString() const;
};

class Perturbation {
 public:
  virtual ~Perturbation() = default;

  // The parametric form: {"gravity", "1.5"}. Numbers in their shortest exact form.
  virtual NamedArgument ToNamedArgument() const = 0;

  // The number or range that the perturbation was given; null where the argument is neither.
  virtual const NumberArgument* number() const { return nullptr; }

  // In the hooks that have it, `number` is the fixed number, or the drawn one of a range; 0 without
  // number(). The other hooks do not learn what was drawn, so a perturbation that needs its number
  // there takes no range.

  // Changes the environment's settings. The number drawn from a range may change an episode's
  // numbers, but no space and no size of the environment.
  virtual void OnOptions(Config& /*config*/, double /*number*/) const {}
  // The file, in the models folder, that replaces the task's own model; "" for none.
  virtual std::string_view model_file() const { return ""; }
  // Changes the compiled model. An error says what the model lacks.
  virtual Status OnModel(mjModel_* /*model*/, double /*number*/) const { return Status(); }
  // Doubles of state per lane; all 0 when an episode starts. The three hooks below get this state.
  // A step calls them in this order, a reset calls OnObservation alone. A perturbation with state
  // works neither in queries nor on datasets, because their rows have no steps before them.
  virtual size_t state_size(const EnvironmentSpec& /*spec*/) const { return 0; }
  // Changes the action that reaches the simulator.
  virtual void OnAction(const DrawContext& /*context*/, std::span<double> /*state*/,
                        std::span<double> /*action*/) const {}
  // Whether OnAction gives a float32 action where it gets one. NumPy's sum of a float32 action and
  // float64 noise, say, is float64.
  virtual bool keeps_float32() const { return true; }
  // Changes the reward that is reported; `context` is that of the observation after the step. The
  // rewards of a dataset stay as they are.
  virtual void OnReward(const DrawContext& /*context*/, std::span<double> /*state*/,
                        double& /*reward*/) const {}
  // Changes the observation that a policy, a query or a dataset's reader sees. It may hold numbers
  // that are not finite.
  virtual void OnObservation(const DrawContext& /*context*/, std::span<double> /*state*/,
                             std::span<double> /*observation*/) const {}
};

// The generator of the random numbers of one row for one perturbation, which draws `per_row` of
// them. `purpose` names the perturbation ("obs-noise"), `occurrence` counts equal names in one set
// from 0.
Rng RowRng(const DrawContext& context, std::string_view purpose, uint64_t occurrence,
           uint64_t per_row);

// Perturbations in the order in which they apply. Movable; immutable once built; any thread.
class PerturbationSet {
 public:
  PerturbationSet() = default;
  PerturbationSet(const EnvironmentSpec& spec, std::vector<std::unique_ptr<Perturbation>> members);

  bool empty() const { return members_.empty(); }
  // The members' parametric forms, in order.
  std::vector<NamedArgument> items() const;
  std::span<const std::unique_ptr<Perturbation>> members() const { return members_; }
  size_t state_size() const { return state_size_; }
  // Whether all members keep an action float32.
  bool keeps_float32() const { return keeps_float32_; }

  // Names of the members that were given a range, in order: "gravity". At most
  // limits::kMaxPerturbations.
  const std::vector<std::string>& parameter_names() const { return parameter_names_; }
  // One number for each of parameter_names(): the upper end of that member's range.
  std::vector<double> LargestParameters() const;
  // Draws one number for each of parameter_names(), for the episode or the row of a query that
  // `context` addresses.
  void DrawParameters(const DrawContext& context, std::span<double> parameters) const;

  void OnOptions(std::span<const double> parameters, Config& config) const;
  // The model_file() of the last member that has one; "" for none.
  std::string model_file() const;
  Status OnModel(std::span<const double> parameters, mjModel_* model) const;
  // `state` has state_size() doubles.
  void OnAction(const DrawContext& context, std::span<double> state,
                std::span<double> action) const;
  void OnReward(const DrawContext& context, std::span<double> state, double& reward) const;
  void OnObservation(const DrawContext& context, std::span<double> state,
                     std::span<double> observation) const;

 private:
  // Calls function(member, its part of `state`) for all members in order.
  template <typename Function>
  void ForEach(std::span<double> state, Function function) const;
  // Every member's number for its hooks: the fixed one, or the one of `parameters`.
  std::vector<double> NumbersInForce(std::span<const double> parameters) const;

  std::vector<std::unique_ptr<Perturbation>> members_;
  std::vector<std::string> parameter_names_;
  std::vector<size_t> state_sizes_;
  size_t state_size_ = 0;
  bool keeps_float32_ = true;
};

}  // namespace b4mrl

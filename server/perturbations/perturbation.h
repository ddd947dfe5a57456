// What makes a simulator differ from the real environment, or corrupts a dataset. Read this first;
// list.h has the table of all perturbations and the paper's presets.
//
// A Perturbation is immutable and stateless; what it must remember between steps (a queue of
// delayed actions) lies in the lane's record and is passed in. Random numbers are
// position-addressed: a draw depends on the DrawContext, the perturbation's name and its occurrence
// among equal names alone, so adding a perturbation changes no other's draws, and the same class
// gives the same kind of noise on a simulator and on a dataset. Any thread.
//
// A perturbation whose argument is one number (gravity=1.5) may take a range instead
// (gravity=0.5..2). Its number is then drawn anew for each episode of a lane and for each row of a
// query. Such numbers are the *parameters* of a set. They are a function of the DrawContext, so
// that nobody has to store them; the hooks are called again whenever they change.
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

// Names one row of random numbers.
struct DrawContext {
  enum class Kind {
    kEpisode,  // a simulator's step
    kQuery,    // a row of T_sim
    kDataset,  // row `minor` of a dataset's noise matrix
    // The next observation of an episode's last row, which is the observation of no row.
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
  double low = 0;  // of a range; else the number itself
  double high = 0;
  bool is_range = false;  // low..high
  bool whole = false;     // whole numbers only, both ends included

  // Uniform between low and high; a function of the arguments. `purpose` is the perturbation's
  // name.
  double Draw(const DrawContext& context, std::string_view purpose) const;
  // "1.5" or "0.5..2", in the shortest exact form.
  std::string ToString() const;
};

class Perturbation {
 public:
  virtual ~Perturbation() = default;

  // The parametric form: {"gravity", "1.5"}. Numbers in their shortest exact form.
  virtual NamedArgument ToNamedArgument() const = 0;

  // The number or range that the perturbation was given; null where its argument is no such.
  virtual const NumberArgument* number() const { return nullptr; }

  // In the hooks `number` is the number in force: the fixed or the drawn one, 0 without number().

  // Changes the environment's settings. Those of a range may change the numbers of an episode, but
  // no space and no size.
  virtual void OnOptions(Config& /*config*/, double /*number*/) const {}
  // The file of the models folder that takes the place of the task's own model; "" for none.
  virtual std::string_view model_file() const { return ""; }
  // Changes the compiled model. An error says what the model lacks.
  virtual Status OnModel(mjModel_* /*model*/, double /*number*/) const { return Status(); }
  // Doubles of state per lane; all 0 when an episode starts. The three hooks below get them as
  // `state`, in this order in each step; a reset calls OnObservation alone. What has state can
  // neither be queried nor corrupt a dataset, because their rows have no steps before them.
  virtual size_t state_size(const EnvironmentSpec& /*spec*/) const { return 0; }
  // Changes what reaches the simulator.
  virtual void OnAction(const DrawContext& /*context*/, std::span<double> /*state*/,
                        std::span<double> /*action*/) const {}
  // Changes the reward that is reported; `context` is that of the observation after the step.
  virtual void OnReward(const DrawContext& /*context*/, std::span<double> /*state*/,
                        double& /*reward*/) const {}
  // Changes what a policy, a query or a dataset's reader sees. Numbers that are not finite pass.
  virtual void OnObservation(const DrawContext& /*context*/, std::span<double> /*state*/,
                             std::span<double> /*observation*/) const {}
};

// A perturbation by a number, which may be a range. It overrides OnOptions or OnModel.
class NumberPerturbation : public Perturbation {
 public:
  NumberPerturbation(std::string_view name, const NumberArgument& number)
      : name_(name), number_(number) {}
  NamedArgument ToNamedArgument() const final { return {name_, number_.ToString()}; }
  const NumberArgument* number() const final { return &number_; }

 private:
  std::string name_;
  NumberArgument number_;
};

// The random numbers of one row for one perturbation: `per_row` draws from the returned generator.
// `purpose` names the perturbation ("obs-noise"), `occurrence` counts equal names in one set from
// 0.
Rng RowRng(const DrawContext& context, std::string_view purpose, uint64_t occurrence,
           uint64_t per_row);

// Perturbations in the order in which they apply. Movable; immutable once built; any thread.
class PerturbationSet {
 public:
  PerturbationSet() = default;
  PerturbationSet(const EnvironmentSpec& spec, std::vector<std::unique_ptr<Perturbation>> members);

  bool empty() const { return members_.empty(); }
  // Parametric forms, in order.
  std::vector<NamedArgument> items() const;
  std::vector<const Perturbation*> members() const;
  size_t state_size() const { return state_size_; }

  // Names of the members that were given a range, in order: "gravity". At most
  // limits::kMaxPerturbations.
  const std::vector<std::string>& parameter_names() const { return parameter_names_; }
  // Numbers of those members, all at the upper ends of their ranges.
  std::vector<double> LargestParameters() const;
  // The numbers of the episode or query's row that `context` is of. `parameters` has one a name.
  void DrawParameters(const DrawContext& context, std::span<double> parameters) const;

  void OnOptions(std::span<const double> parameters, Config& config) const;
  // The last one that is named; "" for none.
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
  // The number in force of every member.
  std::vector<double> NumbersInForce(std::span<const double> parameters) const;

  std::vector<std::unique_ptr<Perturbation>> members_;
  std::vector<std::string> parameter_names_;
  std::vector<size_t> state_sizes_;
  size_t state_size_ = 0;
};

}  // namespace b4mrl

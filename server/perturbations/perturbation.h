// What makes a simulator differ from the real environment, or corrupts a dataset. Read this first;
// list.h has the table of all perturbations and the paper's presets.
//
// A Perturbation is immutable and stateless; what one must remember between steps (a queue of
// delayed actions) lies in the lane's record and is passed in. Random numbers are
// position-addressed: a draw depends on the DrawContext, the perturbation's name and its occurrence
// among equal names alone, so adding one changes no other's draws, and the same class gives the
// same kind of noise on a simulator and on a dataset. Any thread.
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
    kEpisode,         // a simulator's step
    kQuery,           // a row of T_sim
    kDataset,         // row `minor` of a dataset's noise matrix
    kDatasetLastRow,  // the next observation of an episode's last row, which is no row's
                      // observation
  };
  Kind kind = Kind::kEpisode;
  uint64_t seed = 0;   // the lane's, the query's or the corruption's
  uint64_t major = 0;  // episode, draw, or noise matrix (each dataset file has its own)
  uint64_t minor =
      0;  // step within the episode (0: after reset), row of the query, row of the dataset
};

class Perturbation {
 public:
  virtual ~Perturbation() = default;

  // The parametric form: {"gravity", "1.5"}. Numbers in their shortest exact form.
  virtual NamedArgument ToNamedArgument() const = 0;

  // Changes the environment's settings before it is opened.
  virtual void OnOptions(Config& /*config*/) const {}
  // The file of the models folder that takes the place of the task's own model; "" for none.
  virtual std::string_view model_file() const { return ""; }
  // Changes the compiled model, once per simulator. An error says what the model lacks.
  virtual Status OnModel(mjModel_* /*model*/) const { return Status(); }
  // Doubles of state per lane; all 0 when an episode starts. What has state cannot be queried,
  // because a query's row has no steps before it.
  virtual size_t state_size(const EnvironmentSpec& /*spec*/) const { return 0; }
  // Changes what reaches the simulator; `state` has state_size() doubles.
  virtual void OnAction(const DrawContext& /*context*/, std::span<double> /*state*/,
                        std::span<double> /*action*/) const {}
  // Changes what a policy, a query or a dataset's reader sees. Numbers that are not finite pass.
  virtual void OnObservation(const DrawContext& /*context*/,
                             std::span<double> /*observation*/) const {}
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

  void OnOptions(Config& config) const;
  // The last one that is named; "" for none.
  std::string model_file() const;
  Status OnModel(mjModel_* model) const;
  // `state` has state_size() doubles.
  void OnAction(const DrawContext& context, std::span<double> state,
                std::span<double> action) const;
  void OnObservation(const DrawContext& context, std::span<double> observation) const;

 private:
  std::vector<std::unique_ptr<Perturbation>> members_;
  std::vector<size_t> state_sizes_;
  size_t state_size_ = 0;
};

}  // namespace b4mrl

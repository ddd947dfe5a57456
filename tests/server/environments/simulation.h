// Shared by the tests of server/environments and server/perturbations: opening simulators, owning
// lanes.
#pragma once

#include <catch2/catch.hpp>
#include <cstring>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "proto/base/rng.h"
#include "server/simulator/lane_stepper.h"
#include "tests/results.h"

namespace b4mrl {

// `perturbations` as on the command line.
inline Result<std::shared_ptr<const Simulator>> TryOpen(const std::string& environment,
                                                        const std::string& perturbations = "",
                                                        const std::string& config = "") {
  auto items = ParseNamedArguments(perturbations);
  if (!items.ok()) return items.status();
  return Simulator::Open({environment, *items, config, ""});
}

inline std::shared_ptr<const Simulator> OpenHalfCheetah(const std::string& perturbations = "",
                                                        const std::string& config = "") {
  return Take(TryOpen("HalfCheetah", perturbations, config));
}

inline bool EqualBytes(std::span<const double> a, std::span<const double> b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

inline std::vector<double> ToVector(std::span<const double> values) {
  return {values.begin(), values.end()};
}

// A uniform random action; a function of (seed, step).
inline std::vector<double> RandomAction(size_t size, uint64_t seed, uint64_t step) {
  Rng rng(seed, "test-action", step);
  std::vector<double> action(size);
  for (double& a : action) a = rng.Uniform(-1, 1);
  return action;
}

// One lane that owns its memory and a scratch environment.
class TestLane {
 public:
  explicit TestLane(std::shared_ptr<const Simulator> simulator,
                    AutoresetMode mode = AutoresetMode::kNextStep, uint64_t seed = 1)
      : simulator_(simulator),
        stepper_(Take(LaneStepper::Create(simulator, mode))),
        environment_(Take(simulator->Borrow())),
        memory_(2, std::vector<double>(stepper_.layout().bytes() / sizeof(double))) {
    stepper_.Initialize(seed, Next());
    Commit();
  }

  const LaneStepper& stepper() const { return stepper_; }
  Environment& environment() { return *environment_; }
  ConstLaneRecord record() const {
    return {stepper_.layout(), reinterpret_cast<const std::byte*>(memory_[current_].data())};
  }
  const LaneHeader& header() const { return record().header(); }
  std::vector<double> observation() const { return ToVector(record().observation()); }
  std::vector<double> final_observation() const { return ToVector(record().final_observation()); }
  std::vector<double> state() const { return ToVector(record().state()); }
  // Every byte of the record.
  const std::vector<double>& memory() const { return memory_[current_]; }
  void set_memory(const std::vector<double>& memory) { memory_[current_] = memory; }

  Status TryReset(std::optional<uint64_t> seed = {}) {
    return Done(stepper_.Reset(*environment_, record(), seed, Next()));
  }
  Status TryStep(std::span<const double> action,
                 ActionPrecision precision = ActionPrecision::kFloat64) {
    return Done(stepper_.Step(*environment_, record(), action, Next(), precision));
  }
  Status TrySetState(const NamedState& state) {
    return Done(stepper_.SetNamedState(*environment_, record(), state, Next()));
  }
  NamedState GetState() { return stepper_.GetNamedState(*environment_, record()); }

  void Reset(std::optional<uint64_t> seed = {}) { RequireOk(TryReset(seed)); }
  void Step(std::span<const double> action, ActionPrecision precision = ActionPrecision::kFloat64) {
    RequireOk(TryStep(action, precision));
  }
  void StepRandomly(uint64_t step, uint64_t seed = 1) {
    Step(RandomAction(stepper_.spec().action.size(), seed, step));
  }
  void TruncateAfterCrash() {
    RequireOk(Done(stepper_.TruncateAfterCrash(*environment_, record(), Next())));
  }

 private:
  LaneRecord Next() {
    return {stepper_.layout(), reinterpret_cast<std::byte*>(memory_[1 - current_].data())};
  }
  void Commit() { current_ = 1 - current_; }
  Status Done(Status status) {
    if (status.ok()) Commit();
    return status;
  }

  std::shared_ptr<const Simulator> simulator_;
  LaneStepper stepper_;
  Simulator::Lease environment_;
  std::vector<std::vector<double>> memory_;
  size_t current_ = 0;
};

}  // namespace b4mrl

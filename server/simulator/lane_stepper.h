// The rules of a lane: when an episode starts, ends and is truncated, what is reported, and which
// random numbers are drawn. Pure functions from one lane record to the next.
//
// Every operation reads `before` and writes all of `after` (which must not overlap it); on an error
// `after` is unspecified and the lane stays at `before`. Random numbers are functions of (lane
// seed, episode, purpose, step), so equal records and actions give equal records on any thread or
// process.
//
// Auto-reset modes are Gymnasium's. next_step: the step after an end ignores its action and reports
// the new episode's first observation, reward 0, both flags false. same_step: the ending step
// itself reports the new episode's observation; the old one is the final observation. disabled:
// nothing resets by itself, and a lane may be stepped on past its end (limits and health are judged
// again on every such step).
//
// No number that is not finite is ever reported: a step that makes the engine warn, or gives such a
// number, repeats the last observation, has reward 0 and ends the episode as truncated with
// cause kNumericalError. The environment's state stays that before the step. What perturbations
// remember goes on, so that an action that fails leaves the queue of a delay as others do.
// Immutable; any thread, one Environment each.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "proto/base/status.h"
#include "server/simulator/lane_record.h"
#include "server/simulator/simulator.h"

namespace b4mrl {

// The number type in which the client sent an action.
enum class ActionPrecision { kFloat64, kFloat32 };

// Whether Simulator::CheckStart, which makes a step, has its say. Sessions whose episodes are
// played already are taken over without it.
enum class StartCheck { kDone, kSkipped };

class LaneStepper {
 public:
  // kInvalidArgument if a record would not fit limits::kLaneBufferBytes; errors of `check`.
  static Result<LaneStepper> Create(std::shared_ptr<const Simulator> simulator, AutoresetMode mode,
                                    StartCheck check = StartCheck::kDone);

  const Simulator& simulator() const { return *simulator_; }
  const EnvironmentSpec& spec() const { return simulator_->spec(); }
  const LaneLayout& layout() const { return layout_; }

  // Writes the record of a lane that has not been reset yet.
  void Initialize(uint64_t lane_seed, LaneRecord record) const;

  // Starts an episode: with a seed, episode 0 of that seed and a new digest; without, the next
  // episode. An episode whose start the engine warns about is skipped; kInternal after several.
  Status Reset(Environment& environment, ConstLaneRecord before, std::optional<uint64_t> seed,
               LaneRecord after) const;

  // Makes one step. kInvalidArgument for an action of the wrong length or with a number that is not
  // finite; kFailedPrecondition for a lane that was never reset.
  Status Step(Environment& environment, ConstLaneRecord before, std::span<const double> action,
              LaneRecord after, ActionPrecision precision = ActionPrecision::kFloat64) const;

  // Replaces a step that has ended its process again and again: the episode ends as truncated with
  // cause kCrash, at the last observation. In mode same_step the next episode starts at once, else
  // with the next reset.
  Status TruncateAfterCrash(Environment& environment, ConstLaneRecord before,
                            LaneRecord after) const;

  // The environment's state in the lane `before`, under readable names.
  NamedState GetNamedState(Environment& environment, ConstLaneRecord before) const;
  // Puts the lane into `state` and observes it. A running episode goes on (seed, steps and return
  // and perturbations' state kept); a lane that was never reset runs from step 0 of its first
  // episode, and one whose episode has ended from step 0 of the next.
  Status SetNamedState(Environment& environment, ConstLaneRecord before, const NamedState& state,
                       LaneRecord after) const;

 private:
  LaneStepper(std::shared_ptr<const Simulator> simulator, AutoresetMode mode, LaneLayout layout)
      : simulator_(std::move(simulator)), mode_(mode), layout_(layout) {}

  // The error with which Step refuses a lane or an action; else OK.
  Status CheckStep(ConstLaneRecord before, std::span<const double> action) const;
  void Observe(const Environment& environment, LaneRecord record) const;
  Status TryStart(Environment& environment, LaneRecord record) const;
  // Starts the record's episode, or the first later one whose start the engine accepts.
  Status StartEpisode(Environment& environment, LaneRecord record) const;
  Status Finish(Environment& environment, LaneRecord record) const;

  std::shared_ptr<const Simulator> simulator_;
  AutoresetMode mode_;
  LaneLayout layout_;
};

}  // namespace b4mrl

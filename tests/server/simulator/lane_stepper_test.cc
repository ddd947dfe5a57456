#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "proto/base/limits.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

constexpr const char* kThreeSteps = R"({"max_episode_steps": 3})";

std::vector<double> Action(uint64_t step) { return RandomAction(6, 1, step); }

TEST_CASE("A lane must be reset before it is stepped") {
  TestLane lane(OpenHalfCheetah());
  REQUIRE(lane.TryStep(Action(0)).code() == StatusCode::kFailedPrecondition);
  lane.Reset();
  REQUIRE(lane.header().phase == LanePhase::kRunning);
  REQUIRE(lane.TryStep(Action(0)).ok());
}

TEST_CASE("An episode is truncated at its limit, with cause, return and length") {
  TestLane lane(OpenHalfCheetah());
  lane.Reset();
  double episode_return = 0;
  for (uint64_t k = 1; k < 1000; ++k) {
    lane.StepRandomly(k);
    REQUIRE(lane.header().truncated == 0);
    REQUIRE(lane.header().episode_ended == 0);
    episode_return += lane.header().reward;
  }
  lane.StepRandomly(1000);
  episode_return += lane.header().reward;
  const LaneHeader& header = lane.header();
  REQUIRE(header.truncated == 1);
  REQUIRE(header.terminated == 0);
  REQUIRE(header.cause == Cause::kLimit);
  REQUIRE(header.episode_ended == 1);
  REQUIRE(header.final_length == 1000);
  REQUIRE(header.final_return == episode_return);
}

TEST_CASE("next_step: the step after an end ignores its action and reports the reset") {
  TestLane lane(OpenHalfCheetah("", kThreeSteps), AutoresetMode::kNextStep);
  lane.Reset();
  const std::vector<double> first = lane.observation();
  for (uint64_t k = 0; k < 3; ++k) lane.Step(Action(k));
  REQUIRE(lane.header().truncated == 1);
  REQUIRE(lane.header().phase == LanePhase::kEnded);
  REQUIRE(lane.final_observation() == lane.observation());

  lane.Step(Action(3));
  REQUIRE(lane.header().episode == 1);
  REQUIRE(lane.header().elapsed_steps == 0);
  REQUIRE(lane.header().reward == 0);
  REQUIRE(lane.header().truncated == 0);
  REQUIRE(lane.header().episode_ended == 0);
  REQUIRE(lane.observation() != first);

  TestLane other(OpenHalfCheetah("", kThreeSteps), AutoresetMode::kNextStep);
  other.Reset();
  other.Reset();  // the same second episode, whatever came before
  REQUIRE(other.observation() == lane.observation());
}

TEST_CASE("same_step: the ending step reports the new episode and keeps the last observation") {
  TestLane lane(OpenHalfCheetah("", kThreeSteps), AutoresetMode::kSameStep);
  TestLane reference(OpenHalfCheetah("", kThreeSteps), AutoresetMode::kDisabled);
  lane.Reset();
  reference.Reset();
  for (uint64_t k = 0; k < 3; ++k) {
    lane.Step(Action(k));
    reference.Step(Action(k));
  }
  REQUIRE(lane.header().truncated == 1);
  REQUIRE(lane.header().reward == reference.header().reward);
  REQUIRE(lane.header().final_length == 3);
  REQUIRE(lane.header().final_return == reference.header().episode_return);
  REQUIRE(lane.final_observation() == reference.observation());
  REQUIRE(lane.header().phase == LanePhase::kRunning);
  REQUIRE(lane.header().episode == 1);
  REQUIRE(lane.header().episode_return == 0);
  reference.Reset();
  REQUIRE(lane.observation() == reference.observation());
  // The new episode goes on at once.
  lane.Step(Action(9));
  reference.Step(Action(9));
  REQUIRE(lane.observation() == reference.observation());
  REQUIRE(lane.header().elapsed_steps == 1);
}

TEST_CASE("disabled: a lane may be stepped past its end and resets only when told") {
  TestLane lane(OpenHalfCheetah("", kThreeSteps), AutoresetMode::kDisabled);
  TestLane unlimited(OpenHalfCheetah(), AutoresetMode::kDisabled);
  lane.Reset();
  unlimited.Reset();
  for (uint64_t k = 0; k < 6; ++k) {
    lane.Step(Action(k));
    unlimited.Step(Action(k));
    REQUIRE(lane.observation() == unlimited.observation());
    REQUIRE(lane.header().truncated == (k >= 2 ? 1 : 0));
  }
  REQUIRE(lane.header().final_length == 6);
  lane.Reset();
  REQUIRE(lane.header().elapsed_steps == 0);
  REQUIRE(lane.header().episode == 1);
  REQUIRE(lane.header().phase == LanePhase::kRunning);
}

TEST_CASE("A seed starts over at episode 0; without one the next episode follows") {
  const auto simulator = OpenHalfCheetah();
  TestLane lane(simulator);
  lane.Reset(42);
  const std::vector<double> first = lane.observation();
  lane.Reset();
  const std::vector<double> second = lane.observation();
  lane.Reset(42);
  REQUIRE(lane.observation() == first);
  REQUIRE(lane.header().episode == 0);
  lane.StepRandomly(1);
  lane.Reset();
  REQUIRE(lane.observation() == second);
  lane.Reset(43);
  REQUIRE(lane.observation() != first);
}

TEST_CASE("Actions of the wrong length or with numbers that are not finite change nothing") {
  TestLane lane(OpenHalfCheetah());
  lane.Reset();
  const std::vector<double> before = lane.memory();
  std::vector<double> action(6, 0.0);
  REQUIRE(lane.TryStep(std::vector<double>(5)).code() == StatusCode::kInvalidArgument);
  REQUIRE(lane.TryStep(std::vector<double>(7)).code() == StatusCode::kInvalidArgument);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    action[4] = bad;
    const Status status = lane.TryStep(action);
    REQUIRE(status.code() == StatusCode::kInvalidArgument);
    REQUIRE(status.message().find("action[4] (fshin)") != std::string::npos);
  }
  REQUIRE(lane.memory() == before);
}

void RequireNumericalEnd(const TestLane& lane, const std::vector<double>& last_observation) {
  REQUIRE(lane.header().cause == Cause::kNumericalError);
  REQUIRE(lane.header().truncated == 1);
  REQUIRE(lane.header().terminated == 0);
  REQUIRE(lane.header().reward == 0);
  REQUIRE(lane.header().episode_ended == 1);
  REQUIRE(lane.final_observation() == last_observation);
}

TEST_CASE("A cost that overflows ends the episode as a numerical error") {
  TestLane lane(OpenHalfCheetah());
  lane.Reset();
  const std::vector<double> last = lane.observation();
  lane.Step(std::vector<double>(6, 1e300));
  RequireNumericalEnd(lane, last);
  REQUIRE(lane.observation() == last);
  REQUIRE(lane.header().final_length == 1);
  REQUIRE(lane.header().final_return == 0);
  lane.Step(Action(0));
  REQUIRE(lane.header().episode == 1);
  REQUIRE(lane.header().cause == Cause::kNone);
}

TEST_CASE("A return that overflows ends the episode as a numerical error") {
  TestLane lane(OpenHalfCheetah("", R"({"ctrl_cost_weight": 1})"));
  lane.Reset();
  const std::vector<double> huge(6, 5e153);  // costs 1.5e308 a step, of at most 1.8e308
  lane.Step(huge);
  REQUIRE(std::isfinite(lane.header().episode_return));
  REQUIRE(lane.header().cause == Cause::kNone);
  const std::vector<double> last = lane.observation();
  lane.Step(huge);
  RequireNumericalEnd(lane, last);
  REQUIRE(std::isfinite(lane.header().final_return));
}

TEST_CASE("A state that blows up ends the episode, in every mode, and the next one is sound") {
  NamedState state = {{"qpos", std::vector<double>(9, 0.0)}, {"qvel", std::vector<double>(9, 9e9)}};
  for (const AutoresetMode mode :
       {AutoresetMode::kNextStep, AutoresetMode::kSameStep, AutoresetMode::kDisabled}) {
    TestLane lane(OpenHalfCheetah(), mode);
    lane.Reset();
    RequireOk(lane.TrySetState(state));
    const std::vector<double> last = lane.observation();
    lane.Step(Action(0));
    RequireNumericalEnd(lane, last);
    if (mode == AutoresetMode::kDisabled) lane.Reset();
    if (mode == AutoresetMode::kNextStep) lane.Step(Action(0));
    REQUIRE(lane.header().episode == 1);

    TestLane untroubled(OpenHalfCheetah(), mode);
    untroubled.Reset();
    untroubled.Reset();
    lane.Step(Action(1));
    untroubled.Step(Action(1));
    REQUIRE(lane.state() == untroubled.state());
  }
}

// Spoils the first observations of episodes 1 to `last`.
class SpoiledStarts : public Perturbation {
 public:
  explicit SpoiledStarts(uint64_t last) : last_(last) {}
  NamedArgument ToNamedArgument() const override { return {"spoiled", std::to_string(last_)}; }
  void OnObservation(const DrawContext& context, std::span<double> /*state*/,
                     std::span<double> observation) const override {
    const bool is_spoiled = context.minor == 0 && context.major >= 1 && context.major <= last_;
    if (is_spoiled) observation[0] = std::nan("");
  }

 private:
  uint64_t last_;
};

std::shared_ptr<const Simulator> WithSpoiledStarts(uint64_t last) {
  const EnvironmentSpec spec = OpenHalfCheetah("", kThreeSteps)->spec();
  std::vector<std::unique_ptr<Perturbation>> members;
  members.push_back(std::make_unique<SpoiledStarts>(last));
  return Take(Simulator::Build("HalfCheetah", Take(ParseConfig(kThreeSteps)),
                               PerturbationSet(spec, std::move(members))));
}

TEST_CASE("An episode whose start is not finite is skipped, and after several the lane gives up") {
  TestLane skips(WithSpoiledStarts(2), AutoresetMode::kSameStep);
  skips.Reset();
  for (uint64_t k = 0; k < 3; ++k) skips.Step(Action(k));
  REQUIRE(skips.header().episode_ended == 1);
  REQUIRE(skips.header().cause == Cause::kLimit);
  REQUIRE(skips.header().episode == 3);
  REQUIRE(skips.header().phase == LanePhase::kRunning);
  TestLane stuck(WithSpoiledStarts(20), AutoresetMode::kSameStep);
  stuck.Reset();
  for (uint64_t k = 0; k < 2; ++k) stuck.Step(Action(k));
  REQUIRE(stuck.TryStep(Action(2)).code() == StatusCode::kInternal);
  REQUIRE(stuck.header().elapsed_steps == 2);
}

TEST_CASE("Equal records and actions give equal bytes, whichever scratch simulates them") {
  const auto simulator = OpenHalfCheetah("obs-noise=0.1,gravity");
  TestLane a(simulator, AutoresetMode::kSameStep, 5);
  TestLane b(simulator, AutoresetMode::kSameStep, 5);
  TestLane disturber(simulator, AutoresetMode::kSameStep, 6);
  a.Reset();
  b.Reset();
  disturber.Reset();
  for (uint64_t k = 0; k < 100; ++k) {
    a.Step(Action(k));
    // The same scratch environment serves another lane in between.
    std::vector<double> other(a.memory().size());
    LaneRecord after(b.stepper().layout(), reinterpret_cast<std::byte*>(other.data()));
    RequireOk(b.stepper().Step(b.environment(), disturber.record(), Action(1000 + k), after));
    disturber.set_memory(other);
    b.Step(Action(k));
    REQUIRE(EqualBytes(a.memory(), b.memory()));
  }
}

TEST_CASE("A snapshot is the record: putting it back repeats the trajectory byte for byte") {
  const auto simulator = OpenHalfCheetah("obs-noise=0.1", kThreeSteps);
  TestLane lane(simulator);
  lane.Reset(9);
  for (uint64_t k = 0; k < 5; ++k) lane.Step(Action(k));
  const std::vector<double> snapshot = lane.memory();
  const auto bytes = std::as_bytes(std::span(snapshot));
  RequireOk(CheckLaneRecord(lane.stepper().layout(), bytes));
  for (uint64_t k = 5; k < 12; ++k) lane.Step(Action(k));

  TestLane other(simulator, AutoresetMode::kNextStep, 77);
  other.set_memory(snapshot);
  for (uint64_t k = 5; k < 12; ++k) other.Step(Action(k));
  REQUIRE(EqualBytes(lane.memory(), other.memory()));
}

TEST_CASE("No lane but a disabled one is stepped past an end that another mode's state brought") {
  const auto simulator = OpenHalfCheetah("", kThreeSteps);
  TestLane ended(simulator, AutoresetMode::kDisabled);
  ended.Reset();
  for (uint64_t k = 0; k < 3; ++k) ended.Step(Action(k));
  TestLane next(simulator, AutoresetMode::kDisabled);
  next.Reset();
  next.Reset();
  for (const AutoresetMode mode : {AutoresetMode::kNextStep, AutoresetMode::kSameStep}) {
    TestLane lane(simulator, mode);
    lane.set_memory(ended.memory());
    lane.Step(Action(3));
    CHECK(lane.observation() == next.observation());
    CHECK(lane.header().reward == 0);
    CHECK(lane.header().episode_ended == 0);
    CHECK(lane.header().elapsed_steps == 0);
  }
}

TEST_CASE("Snapshots that are no lanes are refused") {
  TestLane lane(OpenHalfCheetah());
  lane.Reset();
  const LaneLayout& layout = lane.stepper().layout();
  const auto refused = [&](auto change) {
    std::vector<double> memory = lane.memory();
    change(LaneRecord(layout, reinterpret_cast<std::byte*>(memory.data())));
    return !CheckLaneRecord(layout, std::as_bytes(std::span(memory))).ok();
  };
  CHECK_FALSE(refused([](LaneRecord) {}));
  CHECK(refused([](LaneRecord r) { r.header().phase = static_cast<LanePhase>(3); }));
  CHECK(refused([](LaneRecord r) { r.header().cause = static_cast<Cause>(5); }));
  CHECK(refused([](LaneRecord r) { r.header().truncated = 2; }));
  CHECK(refused([](LaneRecord r) { r.header().episode_return = std::nan(""); }));
  CHECK(refused([](LaneRecord r) { r.state()[3] = std::nan(""); }));
  CHECK(refused([](LaneRecord r) { r.observation()[0] = HUGE_VAL; }));
  // What a session of float32 would send as infinite. Infos are float64.
  CHECK(refused([](LaneRecord r) { r.observation()[0] = 3.5e38; }));
  CHECK(refused([](LaneRecord r) { r.final_observation().back() = -3.5e38; }));
  CHECK_FALSE(refused([](LaneRecord r) { r.observation()[0] = 3.4e38; }));
  CHECK_FALSE(refused([](LaneRecord r) { r.infos()[0] = 3.5e38; }));
  const auto bytes = std::as_bytes(std::span(lane.memory()));
  CHECK_FALSE(CheckLaneRecord(layout, bytes.first(bytes.size() - 1)).ok());
  CHECK_FALSE(CheckLaneRecord(layout, bytes.first(0)).ok());
}

TEST_CASE("Setting a state keeps a running episode and starts one that is not running") {
  TestLane lane(OpenHalfCheetah("", kThreeSteps));
  const NamedState state = {{"qpos", std::vector<double>(9, 0.01)},
                            {"qvel", std::vector<double>(9, 0.02)}};
  RequireOk(lane.TrySetState(state));  // never reset
  REQUIRE(lane.header().phase == LanePhase::kRunning);
  lane.Step(Action(0));
  RequireOk(lane.TrySetState(state));
  REQUIRE(lane.header().elapsed_steps == 1);
  lane.Step(Action(1));
  lane.Step(Action(2));
  REQUIRE(lane.header().truncated == 1);
  RequireOk(lane.TrySetState(state));
  REQUIRE(lane.header().phase == LanePhase::kRunning);
  REQUIRE(lane.header().elapsed_steps == 0);
  REQUIRE(lane.GetState().at("qpos") == state.at("qpos"));
}

TEST_CASE("The digest tells trajectories apart and starts over with a seed") {
  const auto simulator = OpenHalfCheetah();
  TestLane a(simulator), b(simulator);
  a.Reset(1);
  b.Reset(1);
  REQUIRE(a.header().digest == b.header().digest);
  a.Step(Action(0));
  b.Step(Action(0));
  REQUIRE(a.header().digest == b.header().digest);
  std::vector<double> nearly = Action(1);
  a.Step(nearly);
  nearly[2] = std::nextafter(nearly[2], 2);
  b.Step(nearly);
  REQUIRE(a.header().digest != b.header().digest);
  a.Reset(1);
  b.Reset(1);
  REQUIRE(a.header().digest == b.header().digest);
}

TEST_CASE("Extreme actions for 100,000 steps let nothing through that is not finite") {
  TestLane lane(OpenHalfCheetah(), AutoresetMode::kSameStep);
  lane.Reset();
  Rng rng(1, "extreme-actions");
  std::vector<double> action(6);
  for (int k = 0; k < 100'000; ++k) {
    for (double& a : action) a = std::exp(rng.Uniform(-20, 400)) * (rng.Below(2) == 0 ? 1 : -1);
    lane.Step(action);
    REQUIRE(std::isfinite(lane.header().reward));
    REQUIRE(std::isfinite(lane.header().episode_return));
    double sum = 0;
    for (const double x : lane.record().observation()) sum += x;
    for (const double x : lane.record().state()) sum += x;
    REQUIRE(std::isfinite(sum));
  }
}

TEST_CASE("A lane fits its buffer") {
  const TestLane lane(OpenHalfCheetah());
  REQUIRE(lane.stepper().layout().state_size == 28);
  REQUIRE(lane.stepper().layout().bytes() <= limits::kLaneBufferBytes);
}

}  // namespace
}  // namespace b4mrl

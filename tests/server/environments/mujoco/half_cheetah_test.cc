#include <cmath>
#include <limits>

#include "tests/reference/half_cheetah_reference.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

struct Variant {
  const char* reference;
  const char* perturbations;
};
constexpr Variant kVariants[] = {{"half_cheetah", ""}, {"half_cheetah_gravity2", "gravity"}};

NamedState StateOf(const HalfCheetahRow& row, bool with_warmstart) {
  NamedState state = {{"qpos", ToVector(row.qpos)}, {"qvel", ToVector(row.qvel)}};
  if (with_warmstart) state["qacc_warmstart"] = ToVector(row.warmstart);
  return state;
}

// time, qpos, qvel, qacc_warmstart, without the time.
void RequireState(std::span<const double> state, const HalfCheetahRow& row) {
  REQUIRE(EqualBytes(state.subspan(1, 9), row.qpos));
  REQUIRE(EqualBytes(state.subspan(10, 9), row.qvel));
  REQUIRE(EqualBytes(state.subspan(19, 9), row.warmstart));
}

TEST_CASE("HalfCheetah replays the recordings bit for bit, saved and loaded at every step") {
  for (const auto& [name, perturbations] : kVariants) {
    const HalfCheetahReference reference(name);
    const auto simulator = OpenHalfCheetah(perturbations);
    // Two scratch simulators take turns, so nothing but the saved numbers can carry the trajectory.
    const Simulator::Lease scratch[] = {Take(simulator->Borrow()), Take(simulator->Borrow())};
    for (size_t i = 0; i < HalfCheetahReference::kTrajectories; ++i) {
      std::vector<double> state(simulator->state_size());
      RequireOk(scratch[0]->SetNamedState(StateOf(reference.Row(i, 0), false)));
      scratch[0]->SaveState(state);
      RequireState(state, reference.Row(i, 0));
      for (size_t k = 1; k <= HalfCheetahReference::kSteps; ++k) {
        const HalfCheetahRow row = reference.Row(i, k);
        Environment& environment = *scratch[k % 2];
        environment.LoadState(state);
        const StepResult result = environment.Step(row.action);
        environment.SaveState(state);
        RequireState(state, row);
        REQUIRE(result.reward == row.reward);
        REQUIRE_FALSE(result.terminated);
        std::vector<double> observation(17);
        environment.Observe(observation);
        REQUIRE(EqualBytes(observation, row.observation()));
      }
    }
  }
}

TEST_CASE("Lanes replay the recordings bit for bit") {
  for (const auto& [name, perturbations] : kVariants) {
    const HalfCheetahReference reference(name);
    TestLane lane(OpenHalfCheetah(perturbations));
    for (size_t i = 0; i < HalfCheetahReference::kTrajectories; ++i) {
      lane.Reset();
      RequireOk(lane.TrySetState(StateOf(reference.Row(i, 0), false)));
      double episode_return = 0;
      for (size_t k = 1; k <= HalfCheetahReference::kSteps; ++k) {
        const HalfCheetahRow row = reference.Row(i, k);
        lane.Step(row.action);
        RequireState(lane.state(), row);
        REQUIRE(EqualBytes(lane.observation(), row.observation()));
        REQUIRE(lane.header().reward == row.reward);
        episode_return += row.reward;
      }
      REQUIRE(lane.header().episode_return == episode_return);
      REQUIRE(lane.header().elapsed_steps == HalfCheetahReference::kSteps);
    }
  }
}

TEST_CASE("A state read from a lane and put into another continues with equal bits") {
  const auto simulator = OpenHalfCheetah();
  TestLane original(simulator);
  original.Reset(7);
  for (uint64_t k = 0; k < 50; ++k) original.StepRandomly(k);
  TestLane copy(simulator);
  RequireOk(copy.TrySetState(original.GetState()));
  REQUIRE(copy.state() == original.state());
  for (uint64_t k = 50; k < 100; ++k) {
    original.StepRandomly(k);
    copy.StepRandomly(k);
    REQUIRE(copy.state() == original.state());
  }
}

TEST_CASE("Without a warm start, a set state is what mj_resetData and mj_forward make of it") {
  const HalfCheetahReference reference("half_cheetah");
  const auto simulator = OpenHalfCheetah();
  const auto environment = Take(simulator->Borrow());
  const HalfCheetahRow row = reference.Row(0, 100);
  RequireOk(environment->SetNamedState(StateOf(row, true)));
  REQUIRE(environment->GetNamedState().at("qacc_warmstart") == ToVector(row.warmstart));
  RequireOk(environment->SetNamedState(StateOf(row, false)));
  const std::vector<double> left = environment->GetNamedState().at("qacc_warmstart");
  REQUIRE(left != ToVector(row.warmstart));
  // Newton converges: forgetting the warm start costs at most 1e-14 after one control step; 1e-12
  // leaves slack.
  environment->Step(reference.Row(0, 101).action);
  const std::vector<double> qpos = environment->GetNamedState().at("qpos");
  for (size_t i = 0; i < qpos.size(); ++i) {
    REQUIRE(qpos[i] == Approx(reference.Row(0, 101).qpos[i]).margin(1e-12).epsilon(0));
  }
}

TEST_CASE("An observation determines the state but for the root's x") {
  const HalfCheetahReference reference("half_cheetah");
  const auto simulator = OpenHalfCheetah();
  const auto environment = Take(simulator->Borrow());
  const HalfCheetahRow row = reference.Row(1, 60);
  const std::vector<double> action = RandomAction(6, 1, 0);
  std::vector<double> queried(17), stepped(17);
  const QueryResult query = environment->Query(row.observation(), action, queried);
  REQUIRE(query.valid);
  std::vector<double> qpos = ToVector(row.qpos);
  qpos[0] = 0;
  const std::vector<double> cold(9, 0.0);
  RequireOk(environment->SetNamedState(
      {{"qpos", qpos}, {"qvel", ToVector(row.qvel)}, {"qacc_warmstart", cold}}));
  const StepResult step = environment->Step(action);
  environment->Observe(stepped);
  REQUIRE(queried == stepped);
  REQUIRE(query.reward == step.reward);
}

TEST_CASE("States that are no states are refused by name") {
  const auto simulator = OpenHalfCheetah();
  const auto environment = Take(simulator->Borrow());
  const std::vector<double> nine(9, 0.0);
  const std::vector<double> bad = {0, 0, 0, 0, 0, 0, 0, 0, std::numeric_limits<double>::infinity()};
  const auto message = [&](const NamedState& state) {
    const Status status = environment->SetNamedState(state);
    REQUIRE_FALSE(status.ok());
    return status.message();
  };
  CHECK(message({{"qpos", nine}}).find("qvel") != std::string::npos);
  CHECK(message({{"qpos", {0, 0}}, {"qvel", nine}}).find("qpos") != std::string::npos);
  CHECK(message({{"qpos", nine}, {"qvel", bad}}).find("qvel[8]") != std::string::npos);
  CHECK(message({{"qpos", nine}, {"qvel", nine}, {"qvell", nine}}).find("'qvel'") !=
        std::string::npos);
}

TEST_CASE("A reset draws positions uniformly within 0.1 and velocities normally with 0.1") {
  const auto simulator = OpenHalfCheetah();
  const auto environment = Take(simulator->Borrow());
  constexpr int kResets = 2000;
  double position_squares = 0, velocity_squares = 0;
  for (uint64_t episode = 0; episode < kResets; ++episode) {
    Rng rng(3, "reset", episode);
    RequireOk(environment->Reset(rng));
    const NamedState state = environment->GetNamedState();
    for (const double x : state.at("qpos")) {
      REQUIRE(std::abs(x) <= 0.1);
      position_squares += x * x;
    }
    for (const double v : state.at("qvel")) velocity_squares += v * v;
  }
  // 18,000 draws each: the variance's standard error is 0.7 % (uniform) and 1.1 % (normal); 5 of
  // them.
  CHECK(position_squares / (9 * kResets) == Approx(0.01 / 3).epsilon(0.035));
  CHECK(velocity_squares / (9 * kResets) == Approx(0.01).epsilon(0.055));
}

TEST_CASE("Torques come from the clipped action, the cost from the action as given") {
  const auto simulator = OpenHalfCheetah();
  const auto environment = Take(simulator->Borrow());
  const HalfCheetahReference reference("half_cheetah");
  const HalfCheetahRow row = reference.Row(0, 30);
  RequireOk(environment->SetNamedState(StateOf(row, true)));
  const double at_bound = environment->Step(std::vector<double>(6, 1.0)).reward;
  const std::vector<double> qpos = environment->GetNamedState().at("qpos");
  RequireOk(environment->SetNamedState(StateOf(row, true)));
  const double beyond = environment->Step(std::vector<double>(6, 3.0)).reward;
  REQUIRE(environment->GetNamedState().at("qpos") == qpos);
  REQUIRE(at_bound - beyond == Approx(0.1 * 6 * (9 - 1)).epsilon(1e-12));  // rounding
}

TEST_CASE("Settings under Gymnasium's names change reward, reset and limit") {
  const auto plain = OpenHalfCheetah();
  const auto other = OpenHalfCheetah("", R"({
      "forward_reward_weight": 2, "ctrl_cost_weight": 0, "reset_noise_scale": 0,
      "max_episode_steps": 7, "version": "v5"})");
  REQUIRE(other->spec().max_episode_steps == 7);
  REQUIRE(plain->spec().max_episode_steps == 1000);
  const auto environment = Take(other->Borrow());
  Rng rng(1, "reset");
  RequireOk(environment->Reset(rng));
  REQUIRE(environment->GetNamedState().at("qpos") == std::vector<double>(9, 0.0));
  const StepResult result = environment->Step(std::vector<double>(6, 0.5));
  const double x = environment->GetNamedState().at("qpos")[0];
  REQUIRE(result.reward == 2 * (x / 0.05));
}

TEST_CASE("Unknown and unfit settings are refused by name") {
  const auto refusal = [](const std::string& config) {
    const auto result = TryOpen("HalfCheetah", "", config);
    REQUIRE_FALSE(result.ok());
    return result.status();
  };
  CHECK(refusal("{").code() == StatusCode::kInvalidArgument);
  CHECK(refusal("[1]").code() == StatusCode::kInvalidArgument);
  CHECK(refusal(R"({"reset_noise_scal": 1})").message().find("'reset_noise_scale'") !=
        std::string::npos);
  CHECK(refusal(R"({"reset_noise_scale": -1})").message().find("reset_noise_scale is '-1'") !=
        std::string::npos);
  CHECK(refusal(R"({"max_episode_steps": 0})").code() == StatusCode::kInvalidArgument);
  CHECK(refusal(R"({"max_episode_steps": 1.5})").code() == StatusCode::kInvalidArgument);
  CHECK(refusal(R"({"version": "v3"})").message().find("v4, v5") != std::string::npos);
  CHECK(refusal(R"({"a":[[[[[[[[[[1]]]]]]]]]]})").message().find("depth") != std::string::npos);
  CHECK(refusal(std::string(10000, ' ')).code() == StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace b4mrl

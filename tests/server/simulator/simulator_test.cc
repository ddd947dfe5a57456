#include "server/simulator/simulator.h"

#include <cmath>
#include <limits>
#include <set>
#include <thread>

#include "server/environments/list.h"
#include "tests/reference/half_cheetah_reference.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

struct Answer {
  QueryResult result;
  std::vector<double> next_observation = std::vector<double>(17, 99.0);
};

Answer Ask(const Simulator& simulator, Environment& environment,
           std::span<const double> observation, std::span<const double> action,
           const QueryRow& row = {}) {
  Answer answer;
  answer.result = simulator.Query(environment, row, observation, action, answer.next_observation);
  return answer;
}

TEST_CASE("A query is one step from the state that the observation describes") {
  const HalfCheetahReference reference("half_cheetah");
  const auto simulator = OpenHalfCheetah();
  const auto environment = Take(simulator->Borrow());
  for (size_t k = 0; k < HalfCheetahReference::kSteps; ++k) {
    const HalfCheetahRow row = reference.Row(0, k);
    const HalfCheetahRow next = reference.Row(0, k + 1);
    const Answer answer = Ask(*simulator, *environment, row.observation(), next.action);
    REQUIRE(answer.result.valid);
    REQUIRE_FALSE(answer.result.terminated);
    // x starts at 0 and the warm start is 0. Newton converges to 1e-14 in position (spec of the
    // recordings); velocities and the reward are such differences over 0.01 s and 0.05 s.
    const std::vector<double> expected = next.observation();
    for (size_t i = 0; i < 17; ++i) {
      REQUIRE(answer.next_observation[i] == Approx(expected[i]).margin(1e-10).epsilon(0));
    }
    REQUIRE(answer.result.reward == Approx(next.reward).margin(1e-10).epsilon(0));
  }
}

TEST_CASE("A query does not depend on what the scratch environment did before") {
  const HalfCheetahReference reference("half_cheetah");
  const auto simulator = OpenHalfCheetah();
  const auto used = Take(simulator->Borrow());
  const auto fresh = Take(simulator->Borrow());
  const HalfCheetahRow row = reference.Row(0, 50);
  const std::vector<double> action = ToVector(reference.Row(0, 51).action);
  const Answer expected = Ask(*simulator, *fresh, row.observation(), action);
  Rng rng(1, "reset");
  RequireOk(used->Reset(rng));
  for (uint64_t k = 0; k < 20; ++k) used->Step(RandomAction(6, 1, k));
  const Answer after_steps = Ask(*simulator, *used, row.observation(), action);
  REQUIRE(EqualBytes(after_steps.next_observation, expected.next_observation));
  REQUIRE(after_steps.result.reward == expected.result.reward);

  const std::vector<double> wild(17, 9e9);
  REQUIRE_FALSE(Ask(*simulator, *used, wild, action).result.valid);
  const Answer after_warning = Ask(*simulator, *used, row.observation(), action);
  REQUIRE(EqualBytes(after_warning.next_observation, expected.next_observation));
}

TEST_CASE("Rows that are not finite or blow up come back invalid and zero") {
  const auto simulator = OpenHalfCheetah("obs-noise=0.1");
  const auto environment = Take(simulator->Borrow());
  const std::vector<double> observation(17, 0.0), action(6, 0.0);
  const auto require_invalid = [](const Answer& answer) {
    REQUIRE_FALSE(answer.result.valid);
    REQUIRE(answer.result.reward == 0);
    REQUIRE_FALSE(answer.result.terminated);
    REQUIRE(answer.next_observation == std::vector<double>(17, 0.0));
  };
  REQUIRE(Ask(*simulator, *environment, observation, action).result.valid);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 1e30}) {
    std::vector<double> bad_observation = observation;
    bad_observation[16] = bad;
    require_invalid(Ask(*simulator, *environment, bad_observation, action));
    std::vector<double> bad_action = action;
    bad_action[0] = bad == 1e30 ? 1e300 : bad;  // 1e30 is clipped and costs a finite 1e59
    require_invalid(Ask(*simulator, *environment, observation, bad_action));
  }
}

TEST_CASE("An action that is not finite is invalid under noise that would clip it, too") {
  const auto simulator = OpenHalfCheetah("action-noise=0.3");
  const auto environment = Take(simulator->Borrow());
  const std::vector<double> observation(17, 0.0);
  REQUIRE(Ask(*simulator, *environment, observation, std::vector<double>(6, 0.0)).result.valid);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    std::vector<double> action(6, 0.0);
    action[5] = bad;
    const Answer answer = Ask(*simulator, *environment, observation, action);
    CHECK_FALSE(answer.result.valid);
    CHECK(answer.result.reward == 0);
    CHECK(answer.next_observation == std::vector<double>(17, 0.0));
  }
}

TEST_CASE("Every contact and limit at once fits the engine's memory") {
  const auto simulator = OpenHalfCheetah();
  const auto environment = Take(simulator->Borrow());
  std::vector<double> observation(17, 0.0);
  observation[0] = -1.5;                              // wholly below the floor
  for (size_t i = 2; i < 8; ++i) observation[i] = 2;  // beyond every joint's limit
  REQUIRE(Ask(*simulator, *environment, observation, std::vector<double>(6, 1.0)).result.valid);
}

TEST_CASE("Query noise is a function of seed, draw and row") {
  const auto simulator = OpenHalfCheetah("obs-noise=0.1");
  const auto plain = OpenHalfCheetah();
  const auto environment = Take(simulator->Borrow());
  const std::vector<double> observation(17, 0.0), action(6, 0.5);
  const auto noise_of = [&](const QueryRow& row) {
    std::vector<double> noise =
        Ask(*simulator, *environment, observation, action, row).next_observation;
    const std::vector<double> clean =
        Ask(*plain, *environment, observation, action).next_observation;
    for (size_t i = 0; i < noise.size(); ++i) noise[i] -= clean[i];
    return noise;
  };
  const std::vector<double> noise = noise_of({1, 2, 3});
  REQUIRE(noise == noise_of({1, 2, 3}));
  REQUIRE(noise != noise_of({2, 2, 3}));
  REQUIRE(noise != noise_of({1, 3, 3}));
  REQUIRE(noise != noise_of({1, 2, 4}));
}

TEST_CASE(
    "A hidden dimension of the query's observation cannot leak, for it is never read elsewhere") {
  const auto simulator = OpenHalfCheetah("hidden=9");
  const auto environment = Take(simulator->Borrow());
  const std::vector<double> observation(17, 0.1), action(6, 0.5);
  const Answer answer = Ask(*simulator, *environment, observation, action);
  REQUIRE(answer.next_observation[9] == 0);
  REQUIRE(answer.next_observation[8] != 0);
}

TEST_CASE("Equal requests share one simulator while anybody holds it") {
  const auto a = OpenHalfCheetah("gravity");
  REQUIRE(a == OpenHalfCheetah("gravity=2", R"({"reset_noise_scale": 0.1})"));
  REQUIRE(a != OpenHalfCheetah("gravity=1.9"));
  REQUIRE(a != OpenHalfCheetah("gravity", R"({"reset_noise_scale": 0.2})"));
}

TEST_CASE("A simulator says everything that is in force") {
  const auto simulator = OpenHalfCheetah("gravity,hidden=v-root-z+16,obs-noise-high");
  REQUIRE(FormatNamedArguments(simulator->resolved_perturbations()) ==
          "gravity=2,obs-noise=0.05,hidden=9+16");
  REQUIRE(simulator->config_json().find("\"reset_noise_scale\":0.1") != std::string::npos);
  const std::string& identity = simulator->identity();
  CHECK(identity.find("gravity=2,obs-noise=0.05,hidden=9+16") != std::string::npos);
  CHECK(identity.find("half_cheetah.xml:") != std::string::npos);
  CHECK(identity.find("MuJoCo 2.2.2") != std::string::npos);
  CHECK(identity.find("dynamics 1") != std::string::npos);
  REQUIRE(identity != OpenHalfCheetah("gravity")->identity());
}

TEST_CASE("Unknown environments are answered with the nearest known one") {
  const Status status = TryOpen("HalfCheeta").status();
  REQUIRE(status.code() == StatusCode::kUnknownName);
  REQUIRE(status.message().find("'HalfCheetah'") != std::string::npos);
}

TEST_CASE("Every environment of the list describes itself and opens") {
  for (const EnvironmentEntry& entry : EnvironmentList()) {
    const EnvironmentSpec spec = Take(DescribeEnvironment(entry.name));
    REQUIRE(spec.name == entry.name);
    const auto simulator = Take(TryOpen(spec.name));
    REQUIRE(simulator->spec().observation.size() == spec.observation.size());
    size_t count = 1;
    for (const uint64_t extent : spec.observation.shape) count *= extent;
    REQUIRE(count == spec.observation.size());
    std::set<std::string> names;
    for (const DimensionSpec& dimension : spec.observation.dimensions) names.insert(dimension.name);
    REQUIRE(names.size() == spec.observation.size());
  }
}

TEST_CASE("Threads that share a simulator get the numbers of one thread") {
  const auto simulator = OpenHalfCheetah("obs-noise=0.1,friction");
  // 0 where something failed: Catch's macros are for one thread.
  const auto run = [&](uint64_t seed) -> uint64_t {
    const auto created = LaneStepper::Create(simulator, AutoresetMode::kSameStep);
    if (!created.ok()) return 0;
    const LaneStepper& stepper = *created;
    std::vector<double> memory[2];
    for (auto& m : memory) m.resize(stepper.layout().bytes() / sizeof(double));
    const auto record = [&](int i) {
      return LaneRecord(stepper.layout(), reinterpret_cast<std::byte*>(memory[i].data()));
    };
    const auto constant = [&](int i) {
      return ConstLaneRecord(stepper.layout(), reinterpret_cast<std::byte*>(memory[i].data()));
    };
    stepper.Initialize(seed, record(0));
    // Borrowed anew for every step, so that threads exchange scratch environments.
    for (int k = 0; k < 200; ++k) {
      const auto environment = simulator->Borrow();
      if (!environment.ok()) return 0;
      const Status status =
          k == 0 ? stepper.Reset(**environment, constant(0), {}, record(1))
                 : stepper.Step(**environment, constant(k % 2),
                                RandomAction(6, seed, static_cast<uint64_t>(k)), record(1 - k % 2));
      if (!status.ok()) return 0;
    }
    return constant(0).header().digest;
  };
  std::vector<uint64_t> alone(4), together(4);
  for (uint64_t i = 0; i < 4; ++i) alone[i] = run(i);
  std::vector<std::thread> threads;
  for (uint64_t i = 0; i < 4; ++i) threads.emplace_back([&, i] { together[i] = run(i); });
  for (std::thread& thread : threads) thread.join();
  REQUIRE(alone == together);
  REQUIRE(alone[0] != 0);
  REQUIRE(alone[0] != alone[1]);
}

}  // namespace
}  // namespace b4mrl

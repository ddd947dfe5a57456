// Numbers drawn anew for each episode and each row of a query: gravity=0.5..2.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "server/environments/list.h"
#include "server/perturbations/list.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

struct Case {
  const char* environment;
  const char* range;  // of one perturbation
  double low, high;

  std::string name() const { return std::string(range).substr(0, std::string(range).find('=')); }
};
constexpr Case kCases[] = {
    {"HalfCheetah", "gravity=0.5..2", 0.5, 2}, {"Humanoid", "gravity=0.5..2", 0.5, 2},
    {"Walker2d", "friction=0.1..3", 0.1, 3},   {"Hopper", "leg=0.6..1.3", 0.6, 1.3},
    {"Walker2d", "leg=0.6..1.3", 0.6, 1.3},    {"Highway", "cars=5..20", 5, 20}};

PerturbationSet Make(const std::string& text, const std::string& environment = "HalfCheetah") {
  return Take(MakePerturbations(Take(ParseNamedArguments(text)),
                                Take(DescribeEnvironment(environment)),
                                PerturbationUse::kSimulator));
}

std::string Refusal(const std::string& text, const std::string& environment = "HalfCheetah") {
  const auto made =
      MakePerturbations(Take(ParseNamedArguments(text)), Take(DescribeEnvironment(environment)),
                        PerturbationUse::kSimulator);
  REQUIRE_FALSE(made.ok());
  CHECK(made.status().code() == StatusCode::kInvalidArgument);
  return made.status().message();
}

double NumberOf(const PerturbationSet& set, const DrawContext& context) {
  double number = 0;
  set.DrawParameters(context, {&number, 1});
  return number;
}

// What `info` has under the range's name: the last column.
double InfoOf(const TestLane& lane) { return lane.record().infos().back(); }

std::vector<double> Outcome(const TestLane& lane) {
  std::vector<double> outcome = lane.observation();
  outcome.push_back(lane.header().reward);
  outcome.push_back(lane.header().terminated);
  return outcome;
}

TEST_CASE("A range is written back as it was read, and spaces stay those of the environment") {
  for (const Case& each : kCases) {
    INFO(each.environment << " " << each.range);
    const auto ranged = Take(TryOpen(each.environment, each.range));
    const auto plain = Take(TryOpen(each.environment));
    CHECK(FormatNamedArguments(ranged->resolved_perturbations()) == each.range);
    CHECK(ranged->spec().observation.size() == plain->spec().observation.size());
    std::vector<std::string> infos = plain->spec().info_names;
    infos.push_back(each.name());
    CHECK(ranged->spec().info_names == infos);
    CHECK(ranged->spec().reset_info_names.back() == each.name());
    CHECK(ranged->identity() != Take(TryOpen(each.environment, each.name() + "=1"))->identity());
  }
}

TEST_CASE("The range, and not only its name, is part of a simulator's identity") {
  CHECK(OpenHalfCheetah("gravity=0.5..2")->identity_hash() !=
        OpenHalfCheetah("gravity=0.5..3")->identity_hash());
  CHECK(OpenHalfCheetah("gravity=0.5..2") == OpenHalfCheetah("gravity=0.5..2.0"));
}

TEST_CASE("An episode that drew a number is one of a simulator with that number, bit for bit") {
  for (const Case& each : kCases) {
    INFO(each.environment << " " << each.range);
    const auto simulator = Take(TryOpen(each.environment, each.range));
    TestLane ranged(simulator, AutoresetMode::kDisabled);
    std::set<double> seen;
    for (uint64_t episode = 0; episode < 4; ++episode) {
      // Where a start draws more numbers for more cars, a later episode of a lane with a range
      // begins elsewhere in the stream than with a fixed number, so these are first episodes.
      const bool is_later = episode > 0 && each.name() != "cars";
      const uint64_t seed = each.name() == "cars" ? 7 + episode : 7;
      ranged.Reset(is_later ? std::nullopt : std::optional<uint64_t>(seed));
      const double number = InfoOf(ranged);
      REQUIRE((number >= each.low && number <= each.high));
      seen.insert(number);
      TestLane fixed(Take(TryOpen(each.environment, fmt::format("{}={}", each.name(), number))),
                     AutoresetMode::kDisabled);
      fixed.Reset(seed);
      for (uint64_t k = 0; is_later && k < episode; ++k) fixed.Reset();
      for (uint64_t step = 0; step < 60; ++step) {
        CAPTURE(episode, step, number);
        REQUIRE(EqualBytes(Outcome(ranged), Outcome(fixed)));
        REQUIRE(InfoOf(ranged) == number);
        const std::vector<double> action =
            RandomAction(ranged.stepper().spec().action.size(), episode, step);
        ranged.Step(action);
        fixed.Step(action);
      }
    }
    CHECK(seen.size() >= 3);  // of 16 numbers of cars, two of four episodes may draw the same
  }
}

TEST_CASE("No two episodes of a lane with a range of cars start with the ego at one place") {
  const auto simulator = Take(TryOpen("Highway", "cars=1..20"));
  for (uint64_t seed = 0; seed < 50; ++seed) {
    TestLane lane(simulator);
    std::set<double> places;
    for (uint64_t episode = 0; episode < 40; ++episode) {
      CAPTURE(seed, episode);
      lane.Reset(episode == 0 ? std::optional<uint64_t>(seed) : std::nullopt);
      REQUIRE(places.insert(lane.GetState().at("vehicles")[0]).second);
    }
  }
}

TEST_CASE("Fixed numbers of cars keep the identity that their snapshots were taken under") {
  const auto identity = [](const char* cars) { return Take(TryOpen("Highway", cars))->identity(); };
  CHECK_THAT(identity("cars=20"), Catch::Contains("model highway-env 1.12; "));
  CHECK_THAT(identity("cars=1..20"), Catch::Contains("model highway-env 1.12, starts apart; "));
}

TEST_CASE("Ranges and fixed numbers apply in their order, as fixed numbers do") {
  const auto open = [](const char* environment, const std::string& perturbations) {
    return std::make_unique<TestLane>(Take(TryOpen(environment, perturbations)),
                                      AutoresetMode::kDisabled);
  };
  const std::string rest = ",friction=0.5,obs-noise=0.01,action-noise=0.1";
  const auto ranged = open("HalfCheetah", "gravity=0.5..2" + rest);
  ranged->Reset(3);
  const auto fixed = open("HalfCheetah", fmt::format("gravity={}{}", InfoOf(*ranged), rest));
  const auto three = open("Hopper", "leg=0.7..1.2,gravity=0.5..2,friction=0.2..3");
  three->Reset(3);
  const auto numbers = three->record().infos().last(3);
  const auto same_three = open(
      "Hopper", fmt::format("leg={},gravity={},friction={}", numbers[0], numbers[1], numbers[2]));
  fixed->Reset(3);
  same_three->Reset(3);
  for (uint64_t step = 0; step < 30; ++step) {
    CAPTURE(step);
    REQUIRE(EqualBytes(Outcome(*ranged), Outcome(*fixed)));
    REQUIRE(EqualBytes(Outcome(*three), Outcome(*same_three)));
    for (const auto& lane : {&ranged, &fixed, &three, &same_three}) (*lane)->StepRandomly(step);
  }
}

TEST_CASE("10,000 episodes draw numbers with the mean and within the bounds of the range") {
  for (const Case& each : kCases) {
    INFO(each.environment << " " << each.range);
    const PerturbationSet set = Make(each.range, each.environment);
    constexpr uint64_t kDraws = 10'000;
    for (const auto kind : {DrawContext::Kind::kEpisode, DrawContext::Kind::kQuery}) {
      double sum = 0, least = each.high, greatest = each.low;
      for (uint64_t i = 0; i < kDraws; ++i) {
        const double number = kind == DrawContext::Kind::kEpisode
                                  ? NumberOf(set, {kind, i % 100, i / 100, 0})
                                  : NumberOf(set, {kind, 1, 2, i});
        sum += number;
        least = std::min(least, number);
        greatest = std::max(greatest, number);
      }
      const bool whole = each.name() == "cars";
      const double width = each.high - each.low;
      // The standard deviation of a uniform number is width / sqrt(12), of whole ones a little
      // more; 5 standard errors of the mean.
      const double std =
          std::sqrt(whole ? ((width + 1) * (width + 1) - 1) / 12 : width * width / 12);
      CHECK(std::abs(sum / kDraws - (each.low + each.high) / 2) < 5 * std / std::sqrt(kDraws));
      CHECK(least >= each.low);
      CHECK(greatest <= each.high);
      // Both ends come up among whole numbers; (1 - 0.005)^10,000 is 1e-22.
      CHECK(least <= each.low + (whole ? 0 : 0.005 * width));
      CHECK(greatest >= each.high - (whole ? 0 : 0.005 * width));
    }
  }
}

TEST_CASE("A number is that of the lane's seed and episode, whatever its step and neighbours") {
  const PerturbationSet set = Make("gravity=0.5..2");
  const PerturbationSet more = Make("obs-noise=1,friction=0.1..3,gravity=0.5..2");
  const double number = NumberOf(set, {DrawContext::Kind::kEpisode, 5, 3, 0});
  CHECK(number == Approx(0.8823154928).epsilon(1e-9));  // as in earlier versions
  CHECK(NumberOf(set, {DrawContext::Kind::kEpisode, 5, 3, 999}) == number);
  CHECK(NumberOf(set, {DrawContext::Kind::kEpisode, 5, 4, 0}) != number);
  CHECK(NumberOf(set, {DrawContext::Kind::kEpisode, 6, 3, 0}) != number);
  CHECK(NumberOf(set, {DrawContext::Kind::kQuery, 5, 3, 0}) != number);
  double both[2];
  more.DrawParameters({DrawContext::Kind::kEpisode, 5, 3, 0}, both);
  CHECK(both[1] == number);
  CHECK((both[0] - 0.1) / 2.9 != Approx((number - 0.5) / 1.5));  // streams of their own
}

TEST_CASE("Lanes that share one scratch environment keep their own numbers") {
  for (const Case& each : kCases) {
    INFO(each.environment << " " << each.range);
    const auto simulator = Take(TryOpen(each.environment, each.range));
    const LaneStepper stepper = Take(LaneStepper::Create(simulator, AutoresetMode::kSameStep));
    const Simulator::Lease shared = Take(simulator->Borrow());
    constexpr size_t kLanes = 4;
    const auto memory = [&] {
      return std::vector<double>(stepper.layout().bytes() / sizeof(double));
    };
    const auto view = [&](std::vector<double>& numbers) {
      return LaneRecord(stepper.layout(), reinterpret_cast<std::byte*>(numbers.data()));
    };
    const auto read = [&](const std::vector<double>& numbers) {
      return ConstLaneRecord(stepper.layout(), reinterpret_cast<const std::byte*>(numbers.data()));
    };
    std::vector<std::unique_ptr<TestLane>> alone;
    std::vector<std::vector<double>> records(kLanes, memory());
    std::vector<double> next = memory();
    for (size_t lane = 0; lane < kLanes; ++lane) {
      alone.push_back(std::make_unique<TestLane>(simulator, AutoresetMode::kSameStep, lane));
      alone.back()->Reset();
      stepper.Initialize(lane, view(next));
      RequireOk(stepper.Reset(*shared, read(next), std::nullopt, view(records[lane])));
    }
    for (uint64_t step = 0; step < 40; ++step) {
      for (size_t lane = 0; lane < kLanes; ++lane) {
        CAPTURE(step, lane);
        REQUIRE(EqualBytes(records[lane], alone[lane]->memory()));
        const auto action = RandomAction(stepper.spec().action.size(), lane, step);
        RequireOk(stepper.Step(*shared, read(records[lane]), action, view(next)));
        records[lane].swap(next);
        alone[lane]->Step(action);
      }
    }
  }
}

TEST_CASE("A record continues with its number in another scratch environment") {
  for (const Case& each : kCases) {
    INFO(each.environment << " " << each.range);
    const auto simulator = Take(TryOpen(each.environment, each.range));
    TestLane walker(simulator), follower(simulator, AutoresetMode::kNextStep, 99);
    walker.Reset(11);
    follower.Reset();
    for (uint64_t step = 0; step < 10; ++step) walker.StepRandomly(step);
    follower.set_memory(walker.memory());
    for (uint64_t step = 10; step < 120; ++step) {
      walker.StepRandomly(step);
      follower.StepRandomly(step);
      REQUIRE(EqualBytes(walker.memory(), follower.memory()));
    }
  }
}

TEST_CASE("A state that is set into a lane runs under the number of the lane's episode") {
  const auto simulator = OpenHalfCheetah("gravity=0.5..2");
  TestLane lane(simulator), other(simulator);
  lane.Reset(1);
  lane.StepRandomly(0);
  const NamedState state = lane.GetState();
  other.Reset(2);
  const double number = InfoOf(other);
  RequireOk(other.TrySetState(state));
  CHECK(InfoOf(other) == number);
  TestLane fixed(OpenHalfCheetah(fmt::format("gravity={}", number)));
  fixed.Reset(2);
  RequireOk(fixed.TrySetState(state));
  for (uint64_t step = 0; step < 5; ++step) {
    REQUIRE(other.observation() == fixed.observation());
    other.StepRandomly(step);
    fixed.StepRandomly(step);
  }
}

TEST_CASE("A query draws a number for each row by seed, draw and row, in any order") {
  for (const Case& each : kCases) {
    if (each.name() == "cars") continue;  // a query's cars are those that the observation shows
    INFO(each.environment << " " << each.range);
    const auto simulator = Take(TryOpen(each.environment, each.range));
    RequireOk(simulator->CheckQueryable());
    TestLane start(Take(TryOpen(each.environment)));
    start.Reset(4);
    const std::vector<double> observation = start.observation();
    const auto action = RandomAction(simulator->spec().action.size(), 1, 1);
    const PerturbationSet set = Make(each.range, each.environment);
    const Simulator::Lease scratch = Take(simulator->Borrow());
    std::vector<double> next(observation.size()), expected(observation.size());
    for (const uint64_t row : {5, 0, 3, 5}) {
      const QueryResult result = simulator->Query(*scratch, {7, 2, row}, observation, action, next);
      const double number = NumberOf(set, {DrawContext::Kind::kQuery, 7, 2, row});
      const auto fixed = Take(TryOpen(each.environment, fmt::format("{}={}", each.name(), number)));
      const QueryResult fixed_result =
          fixed->Query(*Take(fixed->Borrow()), {}, observation, action, expected);
      REQUIRE(result.valid);
      CHECK(EqualBytes(next, expected));
      CHECK(result.reward == fixed_result.reward);
    }
  }
  CHECK(Take(TryOpen("Highway", "cars=5..20"))->CheckQueryable().ok());
}

TEST_CASE("What is no range within the bounds is refused with the value and what is allowed") {
  CHECK_THAT(Refusal("gravity=2..0.5"),
             Catch::Contains("2..0.5") && Catch::Contains("LOW <= HIGH"));
  CHECK_THAT(Refusal("gravity=0.5..11"),
             Catch::Contains("upper end of gravity is '11'") && Catch::Contains("-10..10"));
  CHECK_THAT(Refusal("gravity=-11..2"), Catch::Contains("lower end of gravity"));
  for (const char* refused :
       {"gravity=nan..2", "gravity=0.5..inf", "gravity=..2", "gravity=0.5..", "gravity=..",
        "gravity=0.5..1..2", "gravity=0.5.2", "friction=-0.1..1", "obs-noise=0.1..0.2"}) {
    INFO(refused);
    Refusal(refused);
  }
  for (const char* refused : {"cars=5..20.5", "cars=5..128", "cars=20..5", "cars=-1..3"}) {
    INFO(refused);
    Refusal(refused, "Highway");
  }
  CHECK_THAT(Refusal("gravity=0.5..2,gravity=2"),
             Catch::Contains("number of gravity perturbations is 2, allowed: 1"));
  Refusal("leg=0.1..1", "Hopper");
  CHECK(Make("gravity=1..1").parameter_names() == std::vector<std::string>{"gravity"});
  CHECK(Make("gravity=-1..-0.5").parameter_names().size() == 1);
}

}  // namespace
}  // namespace b4mrl

// b4mrl demo: the paper's examples, small enough to read.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "algorithms/tools/command.h"
#include "client/interrupt.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

// The paper's example of hidden confounding (section "Confounding Bias"): one state, two actions a0
// and a1, a reward r in {0, 1}, and z in {0, 1}, which the log hides.
constexpr double kProbabilityOfZ1 = 2.0 / 3;
// P(r = 1 | z, a), indexed by z, then a. a1 is better for either z.
// (The paper prints z = 1 twice; its fourth number belongs to z = 0.)
constexpr double kReward[2][2] = {{1.0 / 6, 1.0 / 4}, {1.0 / 3, 1.0 / 2}};
constexpr std::array<const char*, 2> kActions = {"a0", "a1"};
constexpr std::array<const char*, 2> kActing = {"5/18", "5/12"};  // E_z P(r = 1 | z, a)

// The action of the logged policy, which saw z.
int Behaviour(int z) { return z == 1 ? 0 : 1; }

struct Estimate {
  uint64_t decisions = 0, rewards = 0;

  void Add(bool reward) {
    ++decisions;
    rewards += reward ? 1 : 0;
  }
  double mean() const { return decisions > 0 ? static_cast<double>(rewards) / decisions : 0; }
  // The standard deviation of mean().
  double deviation() const {
    return decisions > 0 ? std::sqrt(mean() * (1 - mean()) / decisions) : 0;
  }
};

class DecisionProblem {
 public:
  explicit DecisionProblem(uint64_t seed) : rng_(seed, "confounding") {}
  int DrawZ() { return rng_.Uniform() < kProbabilityOfZ1 ? 1 : 0; }
  bool DrawReward(int z, int action) { return rng_.Uniform() < kReward[z][action]; }

 private:
  Rng rng_;
};

using Estimates = std::array<Estimate, 2>;  // one per action

// Estimates P(r = 1 | a) from a log of the behaviour policy.
Estimates EstimateFromLog(DecisionProblem& problem, uint64_t decisions) {
  Estimates estimates;
  for (uint64_t i = 0; i < decisions && !Interrupted(); ++i) {
    const int z = problem.DrawZ();
    const int action = Behaviour(z);
    estimates[action].Add(problem.DrawReward(z, action));
  }
  return estimates;
}

// Estimates E_z P(r = 1 | z, a) by taking each action `decisions` times, whatever z is.
Estimates EstimateByActing(DecisionProblem& problem, uint64_t decisions) {
  Estimates estimates;
  for (int action = 0; action < 2; ++action) {
    for (uint64_t i = 0; i < decisions && !Interrupted(); ++i) {
      estimates[action].Add(problem.DrawReward(problem.DrawZ(), action));
    }
  }
  return estimates;
}

int BestOf(const Estimates& estimates) { return estimates[1].mean() > estimates[0].mean() ? 1 : 0; }

void PrintTable(const Estimates& logged, const Estimates& acted, uint64_t decisions) {
  fmt::print("{} logged decisions. A hidden z decided both the action and the reward.\n\n",
             decisions);
  fmt::print("  action   times logged   reward in the log   reward of acting   exactly\n");
  for (int action = 0; action < 2; ++action) {
    fmt::print("  {:<6}   {:>12}   {:.4f} +- {:.4f}    {:.4f} +- {:.4f}   {}\n", kActions[action],
               logged[action].decisions, logged[action].mean(), logged[action].deviation(),
               acted[action].mean(), acted[action].deviation(), kActing[action]);
  }
  fmt::print("\n  best     {:>12}   {:<17}   {}\n", "", kActions[BestOf(logged)],
             kActions[BestOf(acted)]);
  fmt::print(
      "\nThe log tends to 1/3 for a0, which it has with z = 1 only, and to 1/4 for a1, which it\n"
      "has with z = 0 only. More of the same data narrows the deviations and leaves the "
      "mistake.\n");
}

void PrintJson(const Estimates& logged, const Estimates& acted, uint64_t decisions) {
  nlohmann::ordered_json out = {{"decisions", decisions}, {"actions", nlohmann::json::array()}};
  for (int action = 0; action < 2; ++action) {
    out["actions"].push_back({{"name", kActions[action]},
                              {"logged", logged[action].decisions},
                              {"logged_reward", logged[action].mean()},
                              {"logged_deviation", logged[action].deviation()},
                              {"acting_reward", acted[action].mean()},
                              {"acting_deviation", acted[action].deviation()}});
  }
  out["best_in_the_log"] = kActions[BestOf(logged)];
  out["best"] = kActions[BestOf(acted)];
  fmt::print("{}\n", out.dump());
}

struct DemoCommand {
  CLI::App* app;
  uint64_t decisions = 1'000'000;
  uint64_t seed = 0;
  bool json = false;

  std::optional<Failure> Confounding() const {
    DecisionProblem problem(seed);
    const Estimates logged = EstimateFromLog(problem, decisions);
    const Estimates acted = EstimateByActing(problem, decisions);
    if (Interrupted()) {
      return Failure{kExitFailed, Status(StatusCode::kUnavailable, "interrupted")};
    }
    (json ? PrintJson : PrintTable)(logged, acted, decisions);
    return std::nullopt;
  }
};

}  // namespace

std::vector<Command> AddDemoCommands(CLI::App& app) {
  auto command = std::make_shared<DemoCommand>();
  CLI::App* demo = app.add_subcommand("demo", "small examples from the paper");
  demo->require_subcommand(1);
  command->app = demo->add_subcommand("confounding",
                                      "why logged decisions mislead when their reason is hidden");
  command->app
      ->add_option("--decisions", command->decisions, "number of decisions in the log [1000000]")
      ->transform(Count(1, 1'000'000'000));
  command->app->add_option("--seed", command->seed, "seed of the random draws [0]")
      ->transform(Seed());
  command->app->add_flag("--json", command->json, "print the result as one JSON object");
  return {{command->app, [command] { return command->Confounding(); }}};
}

}  // namespace b4mrl

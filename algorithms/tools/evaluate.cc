// b4mrl evaluate: measures the score of an agent file.
#include <fmt/format.h>

#include <array>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "algorithms/base/learner.h"
#include "algorithms/episodes/evaluate.h"
#include "algorithms/policy/agent_policy.h"
#include "algorithms/tools/command.h"
#include "algorithms/tools/video_writer.h"
#include "data/d4rl/agent_file.h"

namespace b4mrl {
namespace {

struct EvaluateCommand {
  CLI::App* app;
  DaemonOptions daemon;
  std::string agent_path, environment, simulator, observe = "trained", video_path;
  uint32_t episodes = 10;
  uint64_t seed = 0;
  bool anyway = false;
  bool replace = false;
  bool json = false;

  void AddOptions();
  std::optional<Failure> Run();
  // Runs the evaluation, with a video of it if `--video` was given.
  std::optional<Failure> Evaluate(Evaluator& evaluator, const AgentPolicy& policy);
  void Print(const EvaluationResult& result) const;
};

void EvaluateCommand::AddOptions() {
  app->add_option("--agent", agent_path, "agent file to evaluate")->required();
  app->add_option("--environment", environment,
                  "environment in which the agent acts: \"HalfCheetah\" [that of its training]");
  app->add_option("--simulator", simulator,
                  "perturbations of the environment [none: the true one]");
  app->add_option("--episodes", episodes, "number of episodes, with deterministic actions [10]")
      ->transform(Count(1, limits::kMaxLanesPerSession));
  app->add_option(
         "--seed", seed,
         "seed of the episodes' starts; 0 gives those of the evaluations during training [0]")
      ->transform(Seed());
  app->add_option(
         "--observe", observe,
         "what the agent observes: trained sets the dimensions that were hidden in training "
         "to 0, full hides none, served adds the noise of its training's observations to trained "
         "[trained]")
      ->check(CLI::IsMember({"trained", "full", "served"}));
  app->add_option("--video", video_path, "file for a film of the first episode (needs ffmpeg)");
  app->add_flag("--replace", replace, "replace a --video that is there already")->needs("--video");
  app->add_flag("--anyway", anyway,
                "evaluate the agent even in an environment other than its training's");
  app->add_flag("--json", json, "print returns and score as one JSON object");
  app->add_option("--config", "TOML file of options; the command line overrides it");
  daemon.AddTo(*app);
}

// The noise through which an agent was trained: that of its data or, without data, of its
// simulator. kFailedPrecondition if there was none.
Result<std::vector<NamedArgument>> NoiseOfTraining(const AgentProvenance& provenance) {
  const bool has_data = !provenance.dataset.empty();
  B4MRL_ASSIGN_OR_RETURN(
      auto items, ParseNamedArguments(has_data ? provenance.corruption : provenance.simulator));
  std::erase_if(items,
                [](const NamedArgument& item) { return !item.name.starts_with("obs-noise"); });
  if (!items.empty()) return items;
  return Status(StatusCode::kFailedPrecondition,
                "--observe served needs an agent whose training's observations were noisy, and its "
                "file names no such training");
}

// Says so where an agent acts in another world than the one it was trained for, whose score it may
// be taken for. Sessions tell, since one world has several names: a preset's and its numbers.
void SayWorldOf(const AgentProvenance& provenance, Client& client, const std::string& environment,
                const std::vector<NamedArgument>& simulator) {
  if (provenance.world.empty()) return;
  const auto in_force = [&](const std::vector<NamedArgument>& perturbations) {
    EnvironmentOptions options;
    options.simulator = perturbations;
    options.deadline_ms = kLearnerDeadlineMs;
    const auto session = client.Make(environment, options);
    return session.ok() ? NamedArgumentsOf(session->in_force().perturbations()) : perturbations;
  };
  const auto world = ParseNamedArguments(provenance.world);
  if (world.ok() && (*world == simulator || in_force(*world) == in_force(simulator))) return;
  fmt::print(stderr,
             "b4mrl: the agent was trained for the world {0}, and is scored in {1}; --simulator "
             "\"{0}\" scores it there\n",
             provenance.world, simulator.empty() ? "the true environment" : "another one");
}

std::optional<Failure> EvaluateCommand::Run() {
  auto agent = ReadAgent(agent_path);
  if (!agent.ok()) return BadInput(agent.status());
  auto policy = AgentPolicy::Create(*agent, observe == "full" ? Observe::kFull : Observe::kTrained);
  if (!policy.ok()) return BadInput(policy.status());
  const std::string& home = agent->provenance.environment;
  if (environment.empty()) environment = home;
  if (environment.empty()) {
    return BadUsage(InvalidArgument("--environment", "",
                                    "a name, as the agent's file does not tell its training's"));
  }
  // Compare names, since tasks may have equal sizes, as HalfCheetah and Walker2d have.
  if (!anyway && !home.empty() && home != environment) {
    return BadInput(
        Status(StatusCode::kInvalidArgument,
               fmt::format("{} was trained on {}, not on {}; --anyway evaluates it there",
                           agent_path, home, environment)));
  }
  if (!video_path.empty()) {
    if (auto failure = CheckOutputFile("--video", video_path, replace)) return failure;
  }
  auto perturbations = ParseNamedArguments(simulator);
  if (!perturbations.ok()) return BadUsage(perturbations.status());
  const std::vector<NamedArgument> acts_in = *perturbations;
  if (observe == "served") {
    const auto noise = NoiseOfTraining(agent->provenance);
    if (!noise.ok()) return BadInput(noise.status());
    perturbations->insert(perturbations->end(), noise->begin(), noise->end());
  }

  auto connection = DaemonConnection::Open(daemon);
  if (!connection.ok()) return FromDaemon(connection.status());
  SayWorldOf(agent->provenance, connection->client(), environment, acts_in);
  auto evaluator =
      Evaluator::Open(connection->client(), environment, *perturbations, episodes, seed);
  if (!evaluator.ok()) return FromDaemon(evaluator.status());
  return Evaluate(*evaluator, *policy);
}

std::optional<Failure> EvaluateCommand::Evaluate(Evaluator& evaluator, const AgentPolicy& policy) {
  std::optional<VideoWriter> video;
  Status video_status;  // errors of the video file, as opposed to errors of the daemon
  const auto film = [&](RemoteEnvironment& session) -> Status {
    constexpr std::array<uint32_t, 1> kFirstLane = {0};
    B4MRL_ASSIGN_OR_RETURN(const Pictures pictures, session.Render(kFirstLane));
    if (!video) {
      auto opened = VideoWriter::Open(video_path, pictures.width, pictures.height,
                                      1 / session.spec().step_seconds);
      if (!opened.ok()) return video_status = opened.status();
      video.emplace(std::move(*opened));
    }
    return video_status = video->Write(pictures.frames);
  };
  const auto result = video_path.empty() ? evaluator.Run(policy) : evaluator.Run(policy, film);
  if (result.ok() && video) {
    video_status = video->Finish(replace ? Existing::kReplace : Existing::kKeep);
  }
  if (!video_status.ok()) return BadInput(video_status);
  if (!result.ok()) return FromDaemon(result.status());
  Print(*result);
  return std::nullopt;
}

void EvaluateCommand::Print(const EvaluationResult& result) const {
  if (json) {
    nlohmann::ordered_json out;
    out["agent"] = agent_path;
    out["environment"] = environment;
    out["simulator"] = simulator;
    out["observe"] = observe;
    out["episodes"] = result.returns.size();
    out["seed"] = seed;
    out["returns"] = result.returns;
    out["lengths"] = result.lengths;
    out["mean_return"] = result.mean_return;
    out["std_return"] = result.std_return;
    out["given_up_episodes"] = result.given_up;
    if (result.score) out["score"] = *result.score;
    fmt::print("{}\n", out.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
    std::fflush(stdout);  // before a private daemon says that it ends, perhaps to the same file
    return;
  }
  for (size_t i = 0; i < result.returns.size(); ++i) {
    fmt::print("episode {:>3}  return {:>10.2f}  length {}\n", i, result.returns[i],
               result.lengths[i]);
  }
  fmt::print("mean return {:.2f} +- {:.2f}\n", result.mean_return, result.std_return);
  if (result.score) fmt::print("normalised score {:.2f}\n", *result.score);
  if (result.given_up > 0) {
    fmt::print("{} of the episodes were given up by the simulator\n", result.given_up);
  }
}

}  // namespace

std::vector<Command> AddEvaluateCommand(CLI::App& app) {
  auto command = std::make_shared<EvaluateCommand>();
  command->app = app.add_subcommand("evaluate", "returns and normalised score of an agent");
  command->AddOptions();
  return {{command->app, [command] { return command->Run(); }}};
}

}  // namespace b4mrl

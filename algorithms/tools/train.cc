// b4mrl train: trains one learner in one run.
#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "algorithms/list.h"
#include "algorithms/run/check_training.h"
#include "algorithms/run/train_loop.h"
#include "algorithms/tools/command.h"
#include "client/interrupt.h"
#include "data/d4rl/agent_file.h"
#include "proto/base/limits.h"
#include "proto/base/names.h"

namespace b4mrl {
namespace {

// How long an interrupted run waits for a daemon that does not answer.
constexpr std::chrono::seconds kInterruptPatience{5};
constexpr uint64_t kMaxUpdates = 1'000'000'000'000;  // would take years

// Names and values of hyperparameters as the user wrote them, in the order given.
using NamedTexts = std::vector<std::pair<std::string, std::string>>;

struct TrainCommand {
  CLI::App* app;
  TrainOptions options;
  DaemonOptions daemon;
  std::string precision{PrecisionName(Precision::kFp32)};
  double stop_at_score = 0;
  bool quiet = false;
  bool json = false;
  bool eval_inline = false;

  void AddOptions();
  std::optional<Failure> Run();
  Result<const Algorithm*> ChosenAlgorithm() const;
  std::optional<Failure> ChooseFolder();
  Status MergeRecord(NamedTexts& hyperparameters);
  Status SetHyperparameters(const Algorithm& algorithm, const NamedTexts& recorded);
  std::optional<Failure> CheckEnvironment(Client& client) const;
  // Completes the dataset's name by the version that the daemon takes, so that the run's files say
  // which data it was trained on, and resuming or repeating it takes the same.
  std::optional<Failure> CompleteDatasetName(Client& client);
  bool Given(const std::string& name) const { return app->count("--" + name) > 0; }
  template <typename T>
  Status Merge(const std::string& name, T& given, const T& recorded);
  Failure RunFailure(const Status& status) const;
  void PrintSummary(const TrainSummary& summary) const;
};

// A hyperparameter's help: "  --batch-size 256 transitions   transitions in the batch [whole,
// 1..65536]", a line for the source of the default, and a line for environments with another
// default.
std::string HelpOf(const Hyperparameter& entry) {
  const std::string unit = entry.unit.empty() ? "" : fmt::format(" {}", entry.unit);
  const std::string allowed =
      entry.choices.empty()
          ? fmt::format("{}{}..{}", entry.whole ? "whole, " : "", entry.low, entry.high)
          : std::string(entry.choices);
  const std::string option = fmt::format("--{} {}{}", entry.name, entry.Text(), unit);
  std::string text = fmt::format("  {:<34} {} [{}]\n", option, entry.meaning, allowed);
  if (!entry.source.empty()) text += fmt::format("  {:<34} from: {}\n", "", entry.source);
  std::string others;
  for (const auto& [environment, value] : entry.by_environment) {
    others +=
        fmt::format("{}{} in {}", others.empty() ? "" : ", ", entry.TextOf(value), environment);
  }
  if (!others.empty()) text += fmt::format("  {:<34} default: {}\n", "", others);
  return text;
}

std::string HelpOf(const Algorithm& algorithm, const std::string& environment) {
  std::string text = fmt::format("Hyperparameters of {} ({}), here with their defaults{}:\n",
                                 algorithm.name, algorithm.description,
                                 environment.empty() ? "" : fmt::format(" in {}", environment));
  const Hyperparameters defaults(algorithm.hyperparameters, environment);
  for (const Hyperparameter& entry : defaults.entries()) text += HelpOf(entry);
  return text;
}

// The end of the help: the chosen algorithm's hyperparameters, or the algorithms to choose from.
std::string AlgorithmHelp(const std::string& chosen, const std::string& environment) {
  const auto found = FindAlgorithm(chosen);
  if (found.ok()) return HelpOf(**found, environment);
  std::string text = chosen.empty() ? "" : fmt::format("{}\n\n", found.status().message());
  text +=
      "\nAlgorithms, whose hyperparameters are options too (b4mrl train --algorithm A --help):\n";
  for (const Algorithm& algorithm : Algorithms()) {
    text += fmt::format("  {:<10} {}\n", algorithm.name, algorithm.description);
  }
  return text;
}

// "sac, td3": the algorithms that `picks` picks.
std::string AlgorithmNames(bool (*picks)(const Algorithm&)) {
  std::string names;
  for (const Algorithm& algorithm : Algorithms()) {
    if (picks(algorithm)) names += fmt::format("{}{}", names.empty() ? "" : ", ", algorithm.name);
  }
  return names;
}

void TrainCommand::AddOptions() {
  app->add_option("--algorithm", options.algorithm,
                  "the learner to train: one of those listed below");
  app->add_option("--environment", options.environment,
                  "environment in which the learner is evaluated: \"HalfCheetah\"");
  app->add_option(
      "--simulator", options.simulator,
      "perturbations of the simulator in which the learner acts: \"gravity,obs-noise-low\"");
  app->add_option("--world", options.world,
                  "perturbations of the true environment in which the learner is evaluated and its "
                  "data were recorded: \"action-delay\"");
  app->add_option("--dataset", options.dataset,
                  "dataset on which the learner trains: \"HalfCheetah/medium\"");
  app->add_option("--corruption", options.corruption,
                  "corruptions of the dataset: \"hidden-high\"");
  AddCorruptionSeed(*app, options.corruption_seed);
  AddTransitions(*app, options.transitions);
  app->add_option("--history", options.history_length,
                  fmt::format("number of most recent observations in the policy's input; above 1 "
                              "with {} alone [1]",
                              AlgorithmNames([](const Algorithm& a) { return a.needs.history; })))
      ->transform(Count(1, kMaxAgentHistory));
  app->add_option(
         "--seed", options.seed,
         "seed of everything random in the training; the starts of evaluations and the noise of "
         "corruptions do not depend on it [0]")
      ->transform(Seed());
  app->add_option("--precision", precision,
                  "precision of matrix products between two hidden layers: fp32, or bf16, which is "
                  "faster and needs a processor with AVX512-BF16 [fp32]")
      ->check(CLI::IsMember({PrecisionName(Precision::kFp32), PrecisionName(Precision::kBf16)}));
  app->add_option("--updates", options.updates, "number of gradient steps of the run [1000000]")
      ->transform(Count(0, kMaxUpdates));
  app->add_option("--eval-every", options.eval_every,
                  "updates from one evaluation to the next [10000]")
      ->transform(Count(1, kMaxUpdates));
  app->add_option("--eval-episodes", options.eval_episodes, "episodes of each evaluation [10]")
      ->transform(Count(1, limits::kMaxLanesPerSession));
  // A hidden option that has no effect: configurations written by earlier versions contain it.
  app->add_flag("--eval-inline", eval_inline)->group("");
  app->add_option("--log-every", options.log_every,
                  "updates from one row of the logs to the next [1000]")
      ->transform(Count(1, kMaxUpdates));
  app->add_option("--checkpoint-every", options.checkpoint_every,
                  "updates from one checkpoint to the next [10000]")
      ->transform(Count(1, kMaxUpdates));
  app->add_option(
      "--stop-at-score", stop_at_score,
      "normalised score at which the run ends: the first evaluation that reaches it is the last");
  app->add_option("--threads", options.threads,
                  "threads of an update, for twin critics and ensemble members side by side; they "
                  "change no number [1; mopo and hymopo: 2]")
      ->transform(Count(1, kMaxTrainingThreads));
  app->add_option(
      "--out", options.folder,
      "folder that keeps the run's files [runs/NAME, with the name made of environment, "
      "algorithm, simulator, dataset, corruption and its seed, transitions, world, history, "
      "precision and seed]");
  app->add_flag("--resume", options.resume,
                "continue the run in --out from its last checkpoint, if it has one");
  app->add_flag("--quiet", quiet, "show no progress on stderr");
  app->add_flag("--json", json, "print the run's result as one JSON object");
  app->add_option("--config", "TOML file of options; the command line overrides it");
  daemon.AddTo(*app);
  app->allow_extras();  // hyperparameters, whose names depend on the algorithm
  app->footer([this] { return AlgorithmHelp(options.algorithm, options.environment); });
}

Result<const Algorithm*> TrainCommand::ChosenAlgorithm() const {
  if (!options.algorithm.empty()) return FindAlgorithm(options.algorithm);
  return Status(StatusCode::kInvalidArgument,
                fmt::format("--algorithm is missing: {}",
                            AlgorithmNames([](const Algorithm&) { return true; })));
}

std::optional<Failure> TrainCommand::ChooseFolder() {
  if (options.folder.empty()) {
    const auto algorithm = ChosenAlgorithm();
    if (!algorithm.ok()) return BadUsage(algorithm.status());
    options.folder = FolderOfRun(options, (*algorithm)->needs);
  }
  // With --algorithm, --resume begins a run if there is none, so that one command does both.
  if (options.resume && options.algorithm.empty() && !HasRunRecord(options.folder)) {
    return BadInput(Status(StatusCode::kUnknownName, options.folder + " holds no run"));
  }
  return std::nullopt;
}

// Merges an identity option: if not given, it takes the recorded value; a different value is
// refused.
template <typename T>
Status TrainCommand::Merge(const std::string& name, T& given, const T& recorded) {
  if (Given(name) && given != recorded) {
    return InvalidArgument(fmt::format("--{}", name), fmt::format("{}", given),
                           fmt::format("{}, as in the run to be resumed", recorded));
  }
  given = recorded;
  return Status();
}

Status TrainCommand::MergeRecord(NamedTexts& hyperparameters) {
  B4MRL_ASSIGN_OR_RETURN(RunRecord record, ReadRunRecord(options.folder));
  const TrainOptions& old = record.options;
  B4MRL_RETURN_IF_ERROR(Merge("algorithm", options.algorithm, old.algorithm));
  B4MRL_RETURN_IF_ERROR(Merge("environment", options.environment, old.environment));
  B4MRL_RETURN_IF_ERROR(Merge("simulator", options.simulator, old.simulator));
  B4MRL_RETURN_IF_ERROR(Merge("world", options.world, old.world));
  // The record has the name with its version, which the user need not write.
  if (WithoutVersion(old.dataset) == options.dataset) options.dataset = old.dataset;
  B4MRL_RETURN_IF_ERROR(Merge("dataset", options.dataset, old.dataset));
  B4MRL_RETURN_IF_ERROR(Merge("corruption", options.corruption, old.corruption));
  B4MRL_RETURN_IF_ERROR(Merge("corruption-seed", options.corruption_seed, old.corruption_seed));
  B4MRL_RETURN_IF_ERROR(Merge("transitions", options.transitions, old.transitions));
  B4MRL_RETURN_IF_ERROR(Merge("history", options.history_length, old.history_length));
  B4MRL_RETURN_IF_ERROR(Merge("seed", options.seed, old.seed));
  B4MRL_RETURN_IF_ERROR(Merge("precision", precision, std::string(PrecisionName(old.precision))));
  options.precision = old.precision;
  if (!Given("updates")) options.updates = old.updates;
  if (!Given("eval-every")) options.eval_every = old.eval_every;
  if (!Given("eval-episodes")) options.eval_episodes = old.eval_episodes;
  if (!Given("threads")) options.threads = old.threads;
  if (!Given("log-every")) options.log_every = old.log_every;
  if (!Given("checkpoint-every")) options.checkpoint_every = old.checkpoint_every;
  if (!Given("stop-at-score")) options.stop_at_score = old.stop_at_score;
  // Record and agents store the command that began the run, since it defines the run.
  options.command = old.command;
  hyperparameters = std::move(record.hyperparameters);
  return Status();
}

// Parses hyperparameters, "--gamma 0.98" or "--gamma=0.98", from the words that CLI11 does not
// know.
Result<NamedTexts> ParseExtras(const std::vector<std::string>& words) {
  NamedTexts values;
  for (size_t i = 0; i < words.size(); ++i) {
    if (!words[i].starts_with("--")) {
      return InvalidArgument("argument", words[i], "options, as --name value");
    }
    std::string name = words[i].substr(2), text;
    if (const size_t equals = name.find('='); equals != std::string::npos) {
      text = name.substr(equals + 1);
      name.resize(equals);
    } else if (i + 1 < words.size()) {
      text = words[++i];
    }
    values.emplace_back(name, text);
  }
  return values;
}

std::vector<std::string> HyperparameterOptions(const Algorithm& algorithm) {
  std::vector<std::string> names;
  for (const Hyperparameter& entry : algorithm.hyperparameters) {
    names.push_back(fmt::format("--{}", entry.name));
  }
  return names;
}

Status TrainCommand::SetHyperparameters(const Algorithm& algorithm, const NamedTexts& recorded) {
  Hyperparameters& values = options.hyperparameters;
  B4MRL_ASSIGN_OR_RETURN(values, ReadHyperparameters(algorithm, options.environment, recorded));
  const Hyperparameters before = values;
  B4MRL_ASSIGN_OR_RETURN(const NamedTexts given, ParseExtras(app->remaining()));
  for (const auto& [name, text] : given) {
    if (values.Find(name) == nullptr) {
      return UnknownOption(*app, "--" + name, HyperparameterOptions(algorithm));
    }
    B4MRL_RETURN_IF_ERROR(values.SetText(name, text));
  }
  for (const Hyperparameter& entry : before.entries()) {
    const Hyperparameter& now = *values.Find(entry.name);
    if (recorded.empty() || now.value == entry.value || entry.is_without_effect) continue;
    return InvalidArgument(fmt::format("--{}", entry.name), now.Text(),
                           fmt::format("{}, as in the run to be resumed", entry.Text()));
  }
  return Status();
}

std::optional<Failure> TrainCommand::CheckEnvironment(Client& client) const {
  const auto environment = client.FindEnvironment(options.environment);
  if (!environment.ok()) return FromDaemon(environment.status());
  if (Status status = CheckTraining(options, *environment); !status.ok()) {
    return BadUsage(std::move(status));
  }
  return std::nullopt;
}

std::optional<Failure> TrainCommand::CompleteDatasetName(Client& client) {
  if (options.dataset.empty()) return std::nullopt;
  const auto dataset = client.OpenDataset(options.dataset);
  if (!dataset.ok()) return FromDataset(dataset.status(), options.dataset);
  options.dataset = dataset->in_force().info().name();
  return std::nullopt;
}

// Exit code of a run that had started. Divergence is a failure (1), not bad input (3).
Failure TrainCommand::RunFailure(const Status& status) const {
  if (IsOfOption(status)) return BadUsage(status);
  if (status.code() == StatusCode::kFailedPrecondition) return {kExitFailed, status};
  if (status.code() == StatusCode::kBusy) return {kExitBusy, status};  // another run in the folder
  Failure failure = FromDaemon(status);
  if (failure.exit_code != kExitNoDaemon || !HasRunRecord(options.folder)) return failure;
  failure.status = Status(status.code(), fmt::format("{}; continue with --resume --out {}",
                                                     status.message(), options.folder));
  const bool by_interrupt = Interrupted() && status.code() == StatusCode::kUnavailable;
  if (by_interrupt) failure.exit_code = kExitInterrupted;
  return failure;
}

// Reports the state of the run that will be resumed.
void SayStateOf(const std::string& folder, Progress& progress) {
  const auto run = ReadRunStatus(folder);
  if (!run.ok()) return;  // there is no run yet, or Train will report the error
  progress.Message(fmt::format("the run in {} so far: {}{}", folder, RunStateName(run->state),
                               run->reason.empty() ? "" : fmt::format(" ({})", run->reason)));
}

std::optional<Failure> TrainCommand::Run() {
  if (Given("stop-at-score")) {
    if (!std::isfinite(stop_at_score)) {
      return BadUsage(
          InvalidArgument("--stop-at-score", fmt::format("{}", stop_at_score), "a finite number"));
    }
    options.stop_at_score = stop_at_score;
  }
  options.precision = *FindPrecision(precision);
  if (auto failure = ChooseFolder()) return failure;
  NamedTexts recorded;
  // A run that was killed before its first checkpoint has a record, too.
  const bool continues = options.resume && HasRunRecord(options.folder);
  if (continues) {
    if (Status status = MergeRecord(recorded); !status.ok()) return BadInput(std::move(status));
  }
  auto algorithm = ChosenAlgorithm();
  if (!algorithm.ok()) return BadUsage(algorithm.status());
  if (!continues && !Given("threads")) options.threads = (*algorithm)->threads;
  if (Status status = SetHyperparameters(**algorithm, recorded); !status.ok()) {
    return BadUsage(std::move(status));
  }
  if (Status status = CheckNeeds(options, **algorithm); !status.ok()) {
    return BadUsage(std::move(status));
  }
  for (const std::string& text : {options.simulator, options.world, options.corruption}) {
    const auto perturbations = ParseNamedArguments(text);
    if (!perturbations.ok()) return BadUsage(perturbations.status());
  }

  auto connection = DaemonConnection::Open(daemon);
  if (!connection.ok()) return FromDaemon(connection.status());
  if (auto failure = CheckEnvironment(connection->client())) return failure;
  if (auto failure = CompleteDatasetName(connection->client())) return failure;
  // A run is known by the complete name of its dataset.
  if (Status status = CheckEarlierRun(options); !status.ok()) return BadInput(std::move(status));
  // From here on an interrupt ends the run with a checkpoint, for which the daemon is asked.
  connection->client().DelayCancellation(kInterruptPatience);
  Progress progress(quiet);
  if (Given("eval-inline")) {
    progress.Message("--eval-inline changes nothing: every evaluation runs in this process");
  }
  if (options.resume) SayStateOf(options.folder, progress);
  const auto summary = Train(options, connection->client(), progress, Interrupted());
  progress.Finish();
  if (!summary.ok()) return RunFailure(summary.status());
  PrintSummary(*summary);
  if (summary->state == RunState::kInterrupted) {
    return Failure{kExitInterrupted,
                   Status(StatusCode::kUnavailable,
                          fmt::format("interrupted at update {}; continue with --resume --out {}",
                                      summary->updates, options.folder))};
  }
  return std::nullopt;
}

void TrainCommand::PrintSummary(const TrainSummary& summary) const {
  if (json) return fmt::print("{}\n", SummaryJson(options, summary));
  if (!summary.last) return;
  fmt::print("return {:.1f} +- {:.1f} over {} episodes after {} updates", summary.last->mean_return,
             summary.last->std_return, summary.last->returns.size(), summary.last_updates);
  if (summary.last->score) fmt::print(", normalised score {:.2f}", *summary.last->score);
  fmt::print("\nagent {}\n", summary.agent_path);
}

}  // namespace

std::vector<Command> AddTrainCommand(CLI::App& app, const std::string& command_line) {
  auto command = std::make_shared<TrainCommand>();
  command->app = app.add_subcommand("train", "train one learner");
  command->options.command = command_line;
  command->AddOptions();
  return {{command->app, [command] { return command->Run(); }}};
}

}  // namespace b4mrl

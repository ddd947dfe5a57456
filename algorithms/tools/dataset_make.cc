// b4mrl dataset make: records datasets by the recipes of dataset_recipes.h, or by the user's own
// behaviour policy.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>

#include "algorithms/datasets/dataset_recipes.h"
#include "algorithms/datasets/dataset_recording.h"
#include "algorithms/datasets/import_name.h"
#include "algorithms/datasets/published_datasets.h"
#include "algorithms/tools/command.h"
#include "algorithms/tools/dataset_place.h"
#include "client/interrupt.h"
#include "data/files/file_hash.h"
#include "proto/base/folders.h"
#include "proto/base/limits.h"
#include "proto/command_line/shell_word.h"

namespace b4mrl {
namespace {

struct MakeCommand {
  std::string name, environment, agent;
  std::optional<uint64_t> rows, seed;
  std::optional<std::string> simulator;
  bool quiet = false;
  bool json = false;
  bool replace = false;
  DaemonOptions daemon;

  std::optional<Failure> Run();
  // Makes every dataset that the data folder does not have. One that fails is reported and does not
  // keep the others back.
  std::optional<Failure> MakeAll(Destination& destination) const;
  std::optional<Failure> MakeOne(const RecordingOrder& order, Destination& destination) const;
  // What to record for the dataset of that name, its files read. Asks no daemon.
  Result<RecordingOrder> OrderOf(const std::string& dataset) const;
  Status ApplyOptions(RecordingOrder& order) const;
  bool ChangesRecipe() const { return !agent.empty() || rows || seed || simulator; }
  void Print(const RecordingOrder& order, const std::string& path, const std::string& sha256,
             const Recording& made, const std::string& verdict) const;
};

std::string SourceFile(std::string_view folder, std::string_view stem) {
  return fmt::format("{}/{}.h5",
                     SharedFolder(folder, fmt::format("{}/{}", B4MRL_DATA_FOLDER, folder)), stem);
}

Failure OrderFailure(const Status& status) {
  return IsOfOption(status) ? BadUsage(status) : BadInput(status);
}

Result<RecordingOrder> MakeCommand::OrderOf(const std::string& dataset) const {
  RecordingOrder order;
  B4MRL_ASSIGN_OR_RETURN(const DatasetName parts, ParseDatasetName(dataset));
  order.name = dataset;
  order.environment = parts.folder;
  const DatasetRecipe* const recipe = FindRecipe(dataset);  // null for a name of the user's own
  if (recipe == nullptr) {
    if (agent.empty()) {
      std::vector<std::string> names;
      for (const DatasetRecipe& known : DatasetRecipes()) names.emplace_back(known.name);
      return UnknownName("dataset", dataset, names)
          .WithContext("a name without a recipe needs its behaviour policy, --agent");
    }
    B4MRL_RETURN_IF_ERROR(CheckIsNoLevel(dataset));  // another version of one would replace it
    order.rows = 1'000'000;
  } else {
    if (!recipe->missing.empty() && agent.empty()) {
      return Status(StatusCode::kUnsupported,
                    fmt::format("{} cannot be made: {}; name another behaviour policy with --agent",
                                recipe->full_name(), recipe->missing));
    }
    order.name = recipe->full_name();
    order.kind = recipe->kind;
    order.simulator = recipe->simulator;
    order.rows = recipe->rows;
    order.seed = recipe->seed;
    const bool is_replay = recipe->kind == RecipeKind::kReplay;
    for (const std::string_view stem : {recipe->source, recipe->second}) {
      if (!stem.empty()) order.files.push_back(SourceFile(is_replay ? "replays" : "agents", stem));
    }
  }
  B4MRL_RETURN_IF_ERROR(ApplyOptions(order));
  B4MRL_RETURN_IF_ERROR(ReadFiles(order));
  if (order.log && order.rows > order.log->rows) {
    return InvalidNumber("--rows", order.rows,
                         fmt::format("1..{}, which the run has", order.log->rows));
  }
  return order;
}

// Replaces what the options name, and writes the command that makes the file again.
Status MakeCommand::ApplyOptions(RecordingOrder& order) const {
  order.command = "b4mrl dataset make " + order.name;
  order.existing = replace ? Existing::kReplace : Existing::kKeep;
  if (!agent.empty()) {
    order.kind = RecipeKind::kAgent;
    order.files = {agent};
    std::error_code error;  // a path that cannot be made absolute stays as it is
    const std::string path = std::filesystem::absolute(agent, error);
    order.command += " --agent " + ShellWord(error ? agent : path);
  }
  const bool is_replay = order.kind == RecipeKind::kReplay;
  if (simulator) {
    if (is_replay)
      return InvalidArgument("--simulator", *simulator, "none for a run's transitions");
    B4MRL_RETURN_IF_ERROR(ParseNamedArguments(*simulator).status().WithContext("--simulator"));
    order.simulator = *simulator;
    order.command += " --simulator " + ShellWord(*simulator);
  }
  if (rows) {
    order.rows = *rows;
    order.command += fmt::format(" --rows {}", *rows);
  }
  if (seed) {
    if (is_replay) {
      return InvalidArgument("--seed", fmt::format("{}", *seed), "none for a run's transitions");
    }
    order.seed = *seed;
    order.command += fmt::format(" --seed {}", *seed);
  }
  return Status();
}

std::optional<Failure> MakeCommand::Run() {
  const bool all = name == "all";
  if (!all && !environment.empty()) {
    return BadUsage(InvalidArgument("--environment", environment, "`dataset make all` alone"));
  }
  if (all && (!agent.empty() || seed || simulator)) {
    return BadUsage(InvalidArgument("all", "--agent, --seed or --simulator", "--rows alone"));
  }
  Destination destination;
  if (all) {
    if (auto failure = destination.Open(daemon)) return failure;
    return MakeAll(destination);
  }
  // What is wrong with a name, an option or a file shows before a daemon is started.
  const auto order = OrderOf(name);
  if (!order.ok()) return OrderFailure(order.status());
  if (auto failure = destination.Open(daemon)) return failure;
  return MakeOne(*order, destination);
}

std::optional<Failure> MakeCommand::MakeAll(Destination& destination) const {
  std::vector<std::string> environments;
  std::optional<Failure> first;
  size_t failed = 0;
  for (const DatasetRecipe& recipe : DatasetRecipes()) {
    if (environments.empty() || environments.back() != recipe.environment()) {
      environments.emplace_back(recipe.environment());
    }
    if (!environment.empty() && environment != recipe.environment()) continue;
    const std::string full_name = recipe.full_name();
    if (!recipe.missing.empty()) {
      fmt::print(stderr, "{} cannot be made: {}\n", full_name, recipe.missing);
      continue;
    }
    if (!replace && destination.Has(full_name)) {
      if (!quiet) fmt::print(stderr, "{}: is there already\n", full_name);
      continue;
    }
    const auto order = OrderOf(full_name);
    auto failure = order.ok() ? MakeOne(*order, destination) : OrderFailure(order.status());
    if (!failure) continue;
    if (Interrupted()) return failure;
    fmt::print(stderr, "{}: {}\n", full_name, failure->status.message());
    if (failure->exit_code == kExitBusy) continue;  // another process makes it, or has just done so
    ++failed;
    if (!first) first = std::move(failure);
  }
  if (first) {
    return Failure{first->exit_code,
                   Status(first->status.code(),
                          fmt::format("{} of the datasets failed, for the reasons above", failed))};
  }
  const bool known = environment.empty() || std::ranges::count(environments, environment) > 0;
  if (known) return std::nullopt;
  return BadInput(UnknownName("environment", environment, environments));
}

// How the made dataset relates to the published one of its name, in words, or what differs.
Result<std::string> Verdict(const RecordingOrder& order, const Recording& made, bool is_changed) {
  B4MRL_ASSIGN_OR_RETURN(const PublishedDatasets published, ReadPublishedDatasets());
  const auto found = published.find(order.name);
  if (found == published.end()) return std::string("no figures are published for it");
  if (is_changed) return std::string("not the published dataset: options change its recipe");
  const std::vector<std::string> differences = Differences(made, found->second);
  if (differences.empty()) return std::string("as published");
  return Status(StatusCode::kDataLoss, fmt::format("{} differs from the published dataset; {}",
                                                   order.name, fmt::join(differences, "; ")));
}

std::optional<Failure> MakeCommand::MakeOne(const RecordingOrder& order,
                                            Destination& destination) const {
  if (auto failure =
          destination.Prepare(order.name, replace, "choose another name, or --replace it")) {
    return failure;
  }
  const auto recorded_in = destination.client().FindEnvironment(order.environment);
  if (!recorded_in.ok()) return FromDaemon(recorded_in.status());
  if (Status status = CheckAgents(order, *recorded_in); !status.ok()) {
    return BadInput(std::move(status));
  }
  const std::string& path = destination.path();
  const auto made = Record(order, *recorded_in, path, destination.client(), quiet);
  // Such a file was not there when the recording began.
  std::error_code unknown;  // what cannot be looked at has not appeared
  const bool appeared = !replace && std::filesystem::exists(path, unknown);
  const bool is_taken = !made.ok() && (made.status().code() == StatusCode::kBusy || appeared);
  if (is_taken) return Failure{kExitBusy, made.status()};
  if (!made.ok()) return FromDaemon(made.status());
  const auto sha256 = Sha256OfFile(path);
  if (!sha256.ok()) return BadInput(sha256.status());
  const auto verdict = Verdict(order, *made, ChangesRecipe());
  Print(order, path, *sha256, *made, verdict.ok() ? *verdict : "differs from the published one");
  if (verdict.ok()) return std::nullopt;
  return Failure{kExitFailed, verdict.status()};
}

void MakeCommand::Print(const RecordingOrder& order, const std::string& path,
                        const std::string& sha256, const Recording& made,
                        const std::string& verdict) const {
  const RecordingSummary& summary = made.summary;
  if (!json) {
    std::string returns;
    if (summary.episodes > 0) returns = fmt::format(", mean return {:.1f}", summary.mean_return);
    if (made.score) returns += fmt::format(", score {:.1f}", *made.score);
    fmt::print("{}: {} rows, {} complete episodes{}\n{}\nsha256 {}\ncolumns {}\n{}\n", order.name,
               summary.rows, summary.episodes, returns, path, sha256, summary.columns_sha256,
               verdict);
    return;
  }
  nlohmann::ordered_json out = {{"name", order.name},
                                {"file", path},
                                {"recipe", made.provenance.recipe},
                                {"policies_sha256", nlohmann::json::array()},
                                {"seeds", nlohmann::json::array()},
                                {"rows", summary.rows},
                                {"episodes", summary.episodes},
                                {"mean_return", summary.mean_return},
                                {"std_return", summary.std_return},
                                {"sha256", sha256},
                                {"columns_sha256", summary.columns_sha256},
                                {"engine", made.provenance.engine},
                                {"license", made.provenance.license},
                                {"verdict", verdict}};
  for (const RecordedPart& part : made.provenance.parts) {
    out["policies_sha256"].push_back(part.policy_sha256);
    out["seeds"].push_back(fmt::format("{}", part.seed));
  }
  if (made.score) out["normalised_score"] = *made.score;
  fmt::print("{}\n", out.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

}  // namespace

std::vector<Command> AddDatasetMake(CLI::App& group) {
  const auto command = std::make_shared<MakeCommand>();
  CLI::App* app =
      group.add_subcommand("make", "record a dataset by its recipe, or episodes of --agent");
  app->add_option("name", command->name,
                  "dataset, \"HalfCheetah/medium\" (b4mrl list datasets has them all), a new name "
                  "with --agent, or \"all\"")
      ->required();
  app->add_option("--environment", command->environment,
                  "with \"all\": the environment whose datasets are made [every environment]");
  app->add_option("--rows", command->rows,
                  "transitions to record; of a medium-replay, so many from the newest episode "
                  "that leaves enough [the recipe's, or 1000000]")
      ->transform(Count(1, limits::kMaxDatasetRows));
  app->add_option("--seed", command->seed,
                  "seed of the episodes' starts and of the actions [the recipe's, or 0]")
      ->transform(Seed());
  app->add_option("--agent", command->agent,
                  "file of an agent with a stochastic policy [the recipe's]");
  app->add_option("--simulator", command->simulator,
                  "perturbations of the world in which the episodes are recorded, "
                  "\"gravity,obs-noise=0.02\" [the recipe's]");
  app->add_flag("--replace", command->replace, "overwrite a dataset of that name");
  app->add_flag("--json", command->json, "print the result as JSON");
  app->add_flag("--quiet", command->quiet, "show no progress on stderr");
  command->daemon.AddTo(*app);
  return {{app, [command] { return command->Run(); }}};
}

}  // namespace b4mrl

// b4mrl list: prints the catalogue. Environments, perturbations and datasets come from the daemon,
// algorithms and the recipes of datasets that have not been made from this program.
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

#include "algorithms/datasets/dataset_recipes.h"
#include "algorithms/datasets/published_datasets.h"
#include "algorithms/list.h"
#include "algorithms/tools/command.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

// Each of these functions makes the JSON object of one line of the listing; the text listing prints
// its "name" and "description".
Json EnvironmentItem(const pb::EnvironmentInfo& info) {
  const int observation_size = info.observation().dimensions_size();
  const int action_size = info.action().dimensions_size();
  Json item = {
      {"name", info.name()},
      {"description",
       fmt::format("{} observation and {} action values, at most {} steps of {} s",
                   observation_size, action_size, info.max_episode_steps(), info.step_seconds())},
      {"reward", info.reward()},
      {"observation_size", observation_size},
      {"action_size", action_size},
      {"max_episode_steps", info.max_episode_steps()},
      {"step_seconds", info.step_seconds()}};
  if (info.has_reference_min()) item["reference_min"] = info.reference_min();
  if (info.has_reference_max()) item["reference_max"] = info.reference_max();
  return item;
}

Json DimensionItems(const pb::Space& space, const char* kind) {
  Json items = Json::array();
  for (int i = 0; i < space.dimensions_size(); ++i) {
    const pb::Dimension& dimension = space.dimensions(i);
    items.push_back(
        {{"name", dimension.name()},
         {"description", fmt::format("{} {}, in {}", kind, i,
                                     dimension.unit().empty() ? "no unit" : dimension.unit())},
         {"space", kind},
         {"index", i},
         {"unit", dimension.unit()},
         {"feature", dimension.feature()}});
  }
  return items;
}

Json PerturbationItem(const pb::PerturbationInfo& info) {
  Json item = {{"name", info.name()},
               {"description", info.description()},
               {"parameter", info.parameter()},
               {"type", info.type()},
               {"low", info.low()},
               {"high", info.high()},
               {"takes_range", info.takes_range()},
               {"corrupts_datasets", info.corrupts_datasets()},
               {"environments", Json::array()},
               {"files", Json::array()},
               {"presets", Json::array()}};
  for (const std::string& name : info.environments()) item["environments"].push_back(name);
  for (const std::string& file : info.files()) item["files"].push_back(file);
  for (const pb::PresetInfo& preset : info.presets()) {
    item["presets"].push_back({{"name", preset.name()},
                               {"environment", preset.environment()},
                               {"argument", preset.argument()}});
  }
  return item;
}

// The syntax of a parametric perturbation: "gravity=<factor> in -10..10, or LOW..HIGH: drawn anew
// for each episode", "model=<file>: heavy.xml light.xml".
std::string ParametricForm(const Json& item) {
  std::string form =
      fmt::format("{}=<{}>", item["name"].get<std::string>(), item["parameter"].get<std::string>());
  const std::string type = item["type"];
  if (type == "number" || type == "integer") {
    form += fmt::format(" in {}..{}", item["low"].get<double>(), item["high"].get<double>());
  }
  if (item["takes_range"]) form += ", or LOW..HIGH: drawn anew for each episode";
  if (type != "file") return form;
  form += item["files"].empty() ? ": the folder has none" : ":";
  for (const Json& file : item["files"]) form += " " + file.get<std::string>();
  return form;
}

// Adds the published figures to an item and returns them in words.
std::string AddFigures(const PublishedDataset& figures, Json& item) {
  std::string words =
      fmt::format(", mean return {:.1f} +- {:.1f}", figures.mean_return, figures.std_return);
  item["mean_return"] = figures.mean_return;
  item["std_return"] = figures.std_return;
  item["license"] = figures.license;
  if (!figures.normalised_score) return words;
  item["normalised_score"] = *figures.normalised_score;
  return words + fmt::format(", score {:.1f}", *figures.normalised_score);
}

// A dataset that has been made. Once the daemon has counted and hashed its rows, the item says
// whether they are those that were published under its name, whose figures are then its own.
Json DatasetItem(const pb::DatasetInfo& info, const PublishedDatasets& published) {
  std::string description =
      fmt::format("{:.1f} MB, ", static_cast<double>(info.file_bytes()) / 1e6) +
      (info.rows() > 0 ? fmt::format("{} rows", info.rows())
                       : std::string("rows are counted when it is first used"));
  Json item = {{"name", info.name()},
               {"description", description},
               {"made", true},
               {"rows", info.rows()},
               {"file_bytes", info.file_bytes()},
               {"sha256", info.sha256()},
               {"columns_sha256", info.columns_sha256()},
               {"behaviour_policy", info.behaviour_policy()}};
  const auto found = published.find(info.name());
  if (found == published.end() || info.columns_sha256().empty()) return item;
  const bool equal = info.columns_sha256() == found->second.columns_sha256;
  item["as_published"] = equal;
  description += equal ? AddFigures(found->second, item) + ", as published"
                       : ", not the rows published under this name";
  item["description"] = description;
  return item;
}

// A dataset that has not been made, with its published figures or the reason why it cannot be made.
Json RecipeItem(const DatasetRecipe& recipe, const PublishedDatasets& published) {
  const bool can_be_made = recipe.missing.empty();
  const std::string description = can_be_made ? fmt::format("not made; {} rows", recipe.rows)
                                              : fmt::format("cannot be made: {}", recipe.missing);
  Json item = {{"name", recipe.full_name()},
               {"description", description},
               {"made", false},
               {"rows", recipe.rows}};
  if (!can_be_made) item["missing"] = recipe.missing;
  const auto found = published.find(recipe.full_name());
  if (found == published.end()) return item;
  item["description"] = description + AddFigures(found->second, item);
  item["columns_sha256"] = found->second.columns_sha256;
  return item;
}

// The datasets in the daemon's data folder, then those that `b4mrl dataset make` knows beside them.
Result<Json> DatasetItems(const std::vector<pb::DatasetInfo>& datasets) {
  B4MRL_ASSIGN_OR_RETURN(const PublishedDatasets published, ReadPublishedDatasets());
  Json items = Json::array();
  for (const pb::DatasetInfo& info : datasets) items.push_back(DatasetItem(info, published));
  for (const DatasetRecipe& recipe : DatasetRecipes()) {
    const auto is_made = [&](const pb::DatasetInfo& info) {
      return info.name() == recipe.full_name();
    };
    if (std::ranges::none_of(datasets, is_made)) items.push_back(RecipeItem(recipe, published));
  }
  return items;
}

Json AlgorithmItem(const Algorithm& algorithm) {
  Json item = {{"name", algorithm.name},
               {"description", algorithm.description},
               {"simulator", algorithm.needs.simulator},
               {"dataset", algorithm.needs.dataset},
               {"hyperparameters", Json::array()}};
  for (const Hyperparameter& entry : algorithm.hyperparameters) {
    Json parameter = {{"name", entry.name}, {"meaning", entry.meaning}};
    if (entry.choices.empty()) {
      parameter["default"] = entry.value;
      parameter["low"] = entry.low;
      parameter["high"] = entry.high;
    } else {
      parameter["default"] = entry.Text();
      parameter["choices"] = entry.ChoiceNames();
    }
    Json& others = parameter["default_by_environment"] = Json::object();
    for (const auto& [environment, value] : entry.by_environment) {
      others[std::string(environment)] =
          entry.choices.empty() ? Json(value) : Json(entry.TextOf(value));
    }
    parameter["unit"] = entry.unit;
    parameter["source"] = entry.source;
    item["hyperparameters"].push_back(std::move(parameter));
  }
  return item;
}

// Whether a benchmark is defined for an algorithm: it has data for one that needs data, and its
// suite says nothing else.
bool IsDefined(const pb::BenchmarkInfo& info, const Algorithm& algorithm) {
  if (algorithm.needs.dataset && info.dataset().empty()) return false;
  if (std::ranges::count(info.exceptions(), algorithm.name) > 0) return false;
  return info.algorithms().empty() || std::ranges::count(info.algorithms(), algorithm.name) > 0;
}

Json BenchmarkItem(const pb::BenchmarkInfo& info) {
  const auto or_none = [](const std::string& text, const char* none) {
    return text.empty() ? none : text;
  };
  Json item = {
      {"name", info.name()},
      {"description", fmt::format("simulator: {}; data: {}{}", or_none(info.simulator(), "true"),
                                  or_none(info.dataset(), "none"),
                                  info.corruption().empty() ? "" : ", " + info.corruption())},
      {"suite", info.suite()},
      {"environment", info.environment()},
      {"challenge", info.challenge()},
      {"simulator", info.simulator()},
      {"dataset", info.dataset()},
      {"corruption", info.corruption()},
      {"world", info.world()},
      {"algorithms", Json::array()},
      {"hyperparameters", Json::object()},
      {"paper", Json::object()}};
  for (const Algorithm& algorithm : Algorithms()) {
    if (IsDefined(info, algorithm)) item["algorithms"].push_back(algorithm.name);
  }
  for (const pb::Hyperparameter& entry : info.hyperparameters()) {
    item["hyperparameters"][entry.name()] = entry.value();
  }
  for (const pb::PaperScore& score : info.paper()) {
    item["paper"][score.algorithm()] = {{"mean", score.mean()}, {"std", score.std()}};
  }
  return item;
}

struct ListCommand {
  CLI::App* app;
  DaemonOptions daemon;
  std::string kind, environment;
  bool json = false;

  std::optional<Failure> Run();
  Result<Json> Items(Client& client) const;
  void Print(const Json& items) const;
};

const std::vector<std::string> kKinds = {"environments", "dimensions", "perturbations",
                                         "corruptions",  "datasets",   "algorithms",
                                         "benchmarks"};

std::optional<Failure> ListCommand::Run() {
  if (std::find(kKinds.begin(), kKinds.end(), kind) == kKinds.end()) {
    return BadUsage(UnknownName("list", kind, kKinds));
  }
  if (kind == "dimensions" && environment.empty()) {
    return BadUsage(InvalidArgument("environment", "", "b4mrl list dimensions ENVIRONMENT"));
  }
  if (kind != "dimensions" && !environment.empty()) {
    return BadUsage(InvalidArgument("environment", environment, "`list dimensions` alone"));
  }
  if (kind != "benchmarks" && !daemon.suites_folder.empty()) {
    return BadUsage(InvalidArgument("--suites", daemon.suites_folder, "`list benchmarks` alone"));
  }
  Json items = Json::array();
  if (kind == "algorithms") {
    for (const Algorithm& algorithm : Algorithms()) items.push_back(AlgorithmItem(algorithm));
  } else {
    auto connection = DaemonConnection::Open(daemon);
    if (!connection.ok()) return FromDaemon(connection.status());
    auto listed = Items(connection->client());
    if (!listed.ok()) return FromDaemon(listed.status());
    items = *std::move(listed);
  }
  Print(items);
  return std::nullopt;
}

Result<Json> ListCommand::Items(Client& client) const {
  Json items = Json::array();
  if (kind == "datasets") {
    B4MRL_ASSIGN_OR_RETURN(const auto datasets, client.ListDatasets());
    return DatasetItems(datasets);
  }
  B4MRL_ASSIGN_OR_RETURN(const pb::CatalogueReply catalogue,
                         client.Catalogue(kind == "benchmarks"));
  if (kind == "benchmarks") {
    for (const pb::BenchmarkInfo& info : catalogue.benchmarks()) {
      items.push_back(BenchmarkItem(info));
    }
    return items;
  }
  if (kind == "perturbations" || kind == "corruptions") {
    for (const pb::PerturbationInfo& info : catalogue.perturbations()) {
      if (kind == "perturbations" || info.corrupts_datasets()) {
        items.push_back(PerturbationItem(info));
      }
    }
    return items;
  }
  std::vector<std::string> names;
  for (const pb::EnvironmentInfo& info : catalogue.environments()) {
    names.push_back(info.name());
    if (kind == "environments") items.push_back(EnvironmentItem(info));
    if (kind != "dimensions" || info.name() != environment) continue;
    items = DimensionItems(info.observation(), "observation");
    for (const Json& item : DimensionItems(info.action(), "action")) items.push_back(item);
    return items;
  }
  if (kind == "dimensions") return UnknownName("environment", environment, names);
  return items;
}

void ListCommand::Print(const Json& items) const {
  if (json) {
    fmt::print("{}\n", items.dump(2, ' ', false, Json::error_handler_t::replace));
    return;
  }
  size_t width = 0;
  for (const Json& item : items) width = std::max(width, item["name"].get<std::string>().size());
  for (const Json& item : items) {
    fmt::print("{:<{}}  {}\n", item["name"].get<std::string>(), width,
               item["description"].get<std::string>());
    if (item.contains("parameter")) {
      fmt::print("{:<{}}    {}\n", "", width, ParametricForm(item));
    }
    for (const Json& preset : item.value("presets", Json::array())) {
      fmt::print("{:<{}}    {} = {}={} on {}\n", "", width, preset["name"].get<std::string>(),
                 item["name"].get<std::string>(), preset["argument"].get<std::string>(),
                 preset["environment"].get<std::string>());
    }
  }
}

}  // namespace

std::vector<Command> AddListCommand(CLI::App& app) {
  auto command = std::make_shared<ListCommand>();
  command->app = app.add_subcommand(
      "list",
      "list environments, dimensions E, perturbations, corruptions, datasets, algorithms or "
      "benchmarks");
  command->app
      ->add_option("kind", command->kind,
                   "environments, dimensions, perturbations, corruptions, datasets, algorithms or "
                   "benchmarks")
      ->required();
  command->app->add_option("environment", command->environment,
                           "environment whose dimensions `list dimensions` names");
  command->app->add_flag("--json", command->json, "print the list as one JSON array");
  command->daemon.AddTo(*command->app);
  command->daemon.AddSuitesTo(*command->app);
  return {{command->app, [command] { return command->Run(); }}};
}

}  // namespace b4mrl

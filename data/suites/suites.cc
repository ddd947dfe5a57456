#include "data/suites/suites.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <system_error>
#include <utility>

#include "data/files/atomic_file.h"
#include "data/files/csv_lines.h"
#include "data/files/folder_listing.h"
#include "data/files/toml_keys.h"
#include "proto/base/folders.h"

namespace b4mrl {
namespace {

constexpr size_t kMaxFileBytes = 1 << 20;

// Names appear in names of files and on command lines. The error is what is allowed.
Status CheckName(const std::string& text) {
  const bool fits = text.size() <= kMaxBenchmarkText && std::ranges::all_of(text, [](char c) {
                      return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
                             std::string_view("-_=.,+").find(c) != std::string_view::npos;
                    });
  if (fits) return Status();
  return Status(
      StatusCode::kInvalidArgument,
      fmt::format("at most {} letters, digits and characters of \"-_=.,+\"", kMaxBenchmarkText));
}

std::string Joined(std::initializer_list<std::string_view> parts) {
  std::string text;
  for (const std::string_view part : parts) {
    if (part.empty()) continue;
    if (!text.empty()) text += '+';
    text += part;
  }
  return text;
}

// Appends the benchmarks of one challenge, which all have what `common` has.
Status AppendChallenge(const toml::table& table, Benchmark common, const std::string& file,
                       std::vector<Benchmark>* out) {
  const auto title = table["name"].value<std::string>();
  TomlKeys keys(table, fmt::format("{}, challenge '{}'", file, title.value_or("")), CheckName);
  B4MRL_ASSIGN_OR_RETURN(common.challenge, keys.Text("name", true));
  B4MRL_ASSIGN_OR_RETURN(const std::string label, keys.Text("label"));
  B4MRL_ASSIGN_OR_RETURN(const auto simulators, keys.Texts("simulators", {""}));
  B4MRL_ASSIGN_OR_RETURN(const auto corruptions, keys.Texts("corruptions", {""}));
  B4MRL_ASSIGN_OR_RETURN(const auto datasets, keys.Texts("datasets", {""}));
  B4MRL_ASSIGN_OR_RETURN(common.algorithms, keys.Texts("algorithms"));
  B4MRL_ASSIGN_OR_RETURN(common.exceptions, keys.Texts("except"));
  B4MRL_ASSIGN_OR_RETURN(common.world, keys.Text("world"));
  B4MRL_ASSIGN_OR_RETURN(common.hyperparameters, keys.Numbers("hyperparameters"));
  B4MRL_RETURN_IF_ERROR(keys.Finish());
  for (const std::string& simulator : simulators) {
    for (const std::string& corruption : corruptions) {
      for (const std::string& dataset : datasets) {
        Benchmark made = common;
        made.simulator = simulator;
        made.corruption = corruption;
        if (!dataset.empty()) made.dataset = fmt::format("{}/{}", made.environment, dataset);
        const bool by_simulator = label.empty() && corruption.empty();
        const std::string varied =
            Joined({label, corruption, by_simulator ? simulator : "", dataset});
        made.name = fmt::format("{}/{}/{}", made.environment, made.challenge, varied);
        if (out->size() >= kMaxBenchmarks) {
          return Status(StatusCode::kLimitExceeded,
                        fmt::format("{} has more than {} benchmarks", file, kMaxBenchmarks));
        }
        out->push_back(std::move(made));
      }
    }
  }
  return Status();
}

Status CheckNames(const std::vector<Benchmark>& benchmarks) {
  std::map<std::string_view, const Benchmark*> seen;
  for (const Benchmark& benchmark : benchmarks) {
    const auto [other, is_new] = seen.emplace(benchmark.name, &benchmark);
    if (is_new) continue;
    const auto text = [](const Benchmark& which) {
      return fmt::format("simulator '{}', dataset '{}', corruption '{}'", which.simulator,
                         which.dataset, which.corruption);
    };
    const bool differ_in_simulator = benchmark.simulator != other->second->simulator;
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("two benchmarks are named {}: {}; and {}{}", benchmark.name,
                              text(*other->second), text(benchmark),
                              differ_in_simulator ? "; give each simulator a [[challenge]] of its "
                                                    "own with a `label`"
                                                  : ""));
  }
  return Status();
}

// Gives the benchmarks the scores of one file. Lines about others are passed over: a folder of the
// user's may hold scores of the project's benchmarks.
Status AddScores(const std::string& path, std::vector<Benchmark>* benchmarks) {
  B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(path, kMaxFileBytes));
  std::map<std::string_view, Benchmark*> by_name;
  for (Benchmark& benchmark : *benchmarks) by_name.emplace(benchmark.name, &benchmark);
  const std::vector<std::string_view> lines = LinesOf(text);
  for (size_t i = 1; i < lines.size(); ++i) {  // behind the columns' names
    if (lines[i].empty()) continue;
    const std::vector<std::string_view> cells = CellsOf(lines[i]);
    const size_t count = cells.size();
    const bool is_whole = count >= 4;
    const double mean = is_whole ? NumberOf(cells[count - 2]).value_or(NAN) : NAN;
    const double std = is_whole ? NumberOf(cells[count - 1]).value_or(NAN) : NAN;
    if (!std::isfinite(mean) || !std::isfinite(std) || std < 0) {
      return Status(
          StatusCode::kInvalidArgument,
          fmt::format("{} line {} is not benchmark,algorithm,mean,std with finite numbers", path,
                      i + 1));
    }
    // A name may hold commas: a corruption of several perturbations does.
    const std::string_view algorithm = cells[count - 3];
    const auto found = by_name.find(lines[i].substr(0, algorithm.data() - lines[i].data() - 1));
    if (found != by_name.end()) found->second->paper[std::string(algorithm)] = {mean, std};
  }
  return Status();
}

}  // namespace

std::string DefaultSuitesFolder() {
  const std::string folder = SharedFolder("suites", B4MRL_SUITES_FOLDER);
  std::error_code error;
  return std::filesystem::is_directory(folder, error) ? folder : "";
}

bool Benchmark::DefinedFor(std::string_view algorithm) const {
  if (std::ranges::count(exceptions, algorithm) > 0) return false;
  return algorithms.empty() || std::ranges::count(algorithms, algorithm) > 0;
}

Result<std::vector<Benchmark>> ParseSuite(const std::string& text, const std::string& file) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table table, ParseToml(text, file));
  TomlKeys keys(table, file, CheckName);
  Benchmark common;
  B4MRL_ASSIGN_OR_RETURN(common.suite, keys.Text("version", true));
  B4MRL_ASSIGN_OR_RETURN(common.environment, keys.Text("environment", true));
  B4MRL_ASSIGN_OR_RETURN(const auto challenges, keys.Tables("challenge"));
  B4MRL_RETURN_IF_ERROR(keys.Finish());
  if (challenges.empty()) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{} must have tables [[challenge]]", file));
  }
  std::vector<Benchmark> benchmarks;
  for (const toml::table* challenge : challenges) {
    B4MRL_RETURN_IF_ERROR(AppendChallenge(*challenge, common, file, &benchmarks));
  }
  B4MRL_RETURN_IF_ERROR(CheckNames(benchmarks).WithContext(file));
  return benchmarks;
}

Result<std::vector<Benchmark>> ReadSuites(const std::vector<std::string>& folders) {
  std::vector<Benchmark> benchmarks;
  for (const std::string& folder : folders) {
    if (folder.empty()) continue;
    B4MRL_ASSIGN_OR_RETURN(const auto files, FilesIn(folder, ".toml"));
    for (const std::string& file : files) {
      B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(file, kMaxFileBytes));
      B4MRL_ASSIGN_OR_RETURN(std::vector<Benchmark> found, ParseSuite(text, file));
      std::ranges::move(found, std::back_inserter(benchmarks));
    }
  }
  if (benchmarks.size() > kMaxBenchmarks) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("the suites have {} benchmarks, allowed: {}", benchmarks.size(),
                              kMaxBenchmarks));
  }
  B4MRL_RETURN_IF_ERROR(CheckNames(benchmarks));
  for (const std::string& folder : folders) {
    if (folder.empty()) continue;
    B4MRL_ASSIGN_OR_RETURN(const auto files, FilesIn(folder, ".csv"));
    for (const std::string& file : files) B4MRL_RETURN_IF_ERROR(AddScores(file, &benchmarks));
  }
  return benchmarks;
}

}  // namespace b4mrl

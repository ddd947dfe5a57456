#include "benchmarks/records/leaderboard.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string_view>

#include "algorithms/datasets/dataset_recipes.h"
#include "benchmarks/records/copied_seeds.h"
#include "benchmarks/records/json_file.h"
#include "benchmarks/records/plain_text.h"
#include "benchmarks/records/result_file.h"
#include "data/files/csv_cell.h"
#include "data/files/folder_listing.h"
#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

// What an entry asks for (benchmarks/RULES.md).
constexpr uint64_t kSeedsOfAnEntry[] = {0, 1, 2};
constexpr size_t kEpisodesOfAnEntry = 10;
constexpr size_t kHashDigits = 12;  // shown of a hash

// Whether a result's dataset has the rows that were published under its name.
bool IsPublished(const Json& dataset, const PublishedDatasets& published) {
  if (dataset.is_null()) return true;  // trained without data
  const auto found = published.find(TextOf(dataset, "name"));
  return found != published.end() &&
         TextOf(dataset, "columns_sha256") == found->second.columns_sha256;
}

// What the table needs of a result that fills these benchmarks: small, whatever its file holds.
Json Needed(const Json& result, const std::set<std::string>& benchmarks) {
  Json needed = SeedMarks(result);
  needed["benchmarks"] = benchmarks;
  for (const char* key :
       {"id", "algorithm", "recipe", "source", "precision", "simulator", "corruption", "world"}) {
    needed[key] = TextOf(result, key);
  }
  const auto add_numbers = [](const Json& from, std::initializer_list<const char*> keys, Json* to) {
    for (const char* key : keys) {
      if (EntryOf(from, key).is_number()) (*to)[key] = EntryOf(from, key);
    }
  };
  add_numbers(result, {"updates", "score", "return", "seconds"}, &needed);
  if (EntryOf(result, "settled").is_boolean()) needed["settled"] = EntryOf(result, "settled");
  needed["episodes"] = NumbersOf(result, "returns").value_or(std::vector<double>()).size();
  Json& ledger = needed["ledger"] = Json::object();
  add_numbers(EntryOf(result, "ledger"), {"simulator_steps", "query_rows", "dataset_rows"},
              &ledger);
  const Json& dataset = EntryOf(result, "dataset");
  if (dataset.is_null()) return needed;
  Json& data = needed["dataset"] = {{"name", TextOf(dataset, "name")},
                                    {"columns_sha256", TextOf(dataset, "columns_sha256")}};
  add_numbers(dataset, {"rows"}, &data);
  return needed;
}

// The benchmarks that a result fills, each once, as far as they are among these, and not with
// another version of their dataset. The others are named in `skipped`.
std::set<std::string> KnownBenchmarks(
    const Json& result, const std::string& file,
    const std::map<std::string_view, const Benchmark*>& benchmarks,
    std::vector<std::string>* skipped) {
  const std::string dataset = DatasetName(result);
  std::set<std::string> known;
  size_t unknown = 0;
  std::string first;
  const std::string* of_other = nullptr;  // the dataset of a benchmark that has another version
  for (const std::string& text : TextsOf(result, "benchmarks")) {
    const auto found = benchmarks.find(text);
    if (found != benchmarks.end() && AreVersionsOfOne(dataset, found->second->dataset)) {
      of_other = &found->second->dataset;
    } else if (found != benchmarks.end()) {
      known.insert(text);
    } else if (unknown++ == 0) {
      first = text;
    }
  }
  if (of_other != nullptr && skipped != nullptr) {
    skipped->push_back(
        fmt::format("{}: its dataset is {}, its benchmark's {}", file, dataset, *of_other));
  }
  if (unknown > 0 && skipped != nullptr) {
    skipped->push_back(
        fmt::format("{}: benchmark '{}'{} is in no suite (--suites names a folder "
                    "of further ones)",
                    file, first, unknown > 1 ? fmt::format(", like {} more,", unknown - 1) : ""));
  }
  return known;
}

// Results of one cell.
struct Cell {
  std::vector<const Json*> results;
  bool has_copies = false;  // of one seed's numbers under the name of another one
  bool has_twins = false;   // two runs of one seed

  // Of a seed that two files tell of the one that came further counts, then fp32, as in the report.
  // Two runs of one seed, in two precisions for one, make no entry.
  void Add(const Json* result) {
    const auto seed = CountOf(*result, "seed");
    const auto rank = [](const Json& of) {
      return std::pair(CountOf(of, "updates"), TextOf(of, "precision"));
    };
    for (const Json*& other : results) {
      if (!seed || CountOf(*other, "seed") != seed) continue;
      const std::string id = TextOf(*result, "id");
      has_twins |= id.empty() || TextOf(*other, "id") != id;
      if (rank(*result) > rank(*other)) other = result;
      return;
    }
    results.push_back(result);
  }
  // The number's mean and deviation over the results; nothing where one lacks it.
  std::optional<MeanAndStd> Figures(std::string_view key, std::string_view inside = "") const {
    std::vector<double> values;
    for (const Json* result : results) {
      const auto number = NumberOf(inside.empty() ? *result : EntryOf(*result, inside), key);
      if (!number) return std::nullopt;
      values.push_back(*number);
    }
    return MeanAndStdOf(values);
  }
  std::set<std::string> Texts(std::string_view key, std::string_view inside = "") const {
    std::set<std::string> texts;
    for (const Json* result : results) {
      texts.insert(TextOf(inside.empty() ? *result : EntryOf(*result, inside), key));
    }
    return texts;
  }
  std::set<uint64_t> Counts(std::string_view key) const {
    std::set<uint64_t> counts;
    for (const Json* result : results) counts.insert(CountOf(*result, key).value_or(0));
    return counts;
  }
  // By the project, not by themselves.
  bool AreScored() const {
    return std::ranges::all_of(Texts("source"), [](const std::string& source) {
      return source == "own" || source == "user";
    });
  }
  bool IsEntry(const PublishedDatasets& published) const {
    const std::set<uint64_t> seeds = Counts("seed"), updates = Counts("updates");
    const bool are_ruled = std::ranges::all_of(results, [&](const Json* result) {
      return CountOf(*result, "episodes") >= kEpisodesOfAnEntry &&
             IsPublished(EntryOf(*result, "dataset"), published);
    });
    return std::ranges::all_of(kSeedsOfAnEntry, [&](uint64_t s) { return seeds.contains(s); }) &&
           seeds.size() == results.size() && updates.size() == 1 && are_ruled && AreScored() &&
           Texts("precision").size() == 1 && !has_copies && !has_twins;
  }
};

std::string Joined(const std::set<std::string>& texts) {
  return fmt::format("{}", fmt::join(texts, "+"));
}

std::string Mean(const std::optional<MeanAndStd>& figures, int digits) {
  return figures ? fmt::format("{:.{}f}", figures->mean, digits) : "";
}

// Over results of several seeds; a single one has none.
std::string Deviation(const std::optional<MeanAndStd>& figures, size_t seeds, int digits) {
  return figures && seeds > 1 ? fmt::format("{:.{}f}", figures->std, digits) : "";
}

// "100" or, of results that went on for unequally long, "100-400".
std::string Range(const std::set<uint64_t>& counts) {
  if (counts.empty()) return "";
  if (counts.size() == 1) return fmt::format("{}", *counts.begin());
  return fmt::format("{}-{}", *counts.begin(), *counts.rbegin());
}

// The columns dataset, rows and rows_sha256; results of one cell have the same rows.
std::string DataColumns(const Cell& cell) {
  const Json& dataset = EntryOf(*cell.results.front(), "dataset");
  const auto rows = CountOf(dataset, "rows");
  return fmt::format("{},{},{}", CsvCell(Joined(cell.Texts("name", "dataset"))),
                     rows ? fmt::format("{}", *rows) : "",
                     CsvCell(TextOf(dataset, "columns_sha256").substr(0, kHashDigits)));
}

std::string RowOf(const std::string& benchmark, const Cell& cell,
                  const PublishedDatasets& published) {
  const auto score = cell.Figures("score"), episode_return = cell.Figures("return");
  const auto has_settled = [](bool settled) {
    return [settled](const Json* result) { return EntryOf(*result, "settled") == settled; };
  };
  // Nothing where a curve is too short to say.
  const char* settled = std::ranges::all_of(cell.results, has_settled(true))    ? "yes"
                        : std::ranges::any_of(cell.results, has_settled(false)) ? "no"
                                                                                : "";
  const size_t seeds = cell.Counts("seed").size();
  auto hours = cell.Figures("seconds");
  if (hours) hours->mean /= 3600;
  return fmt::format(
      "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", CsvCell(benchmark),
      CsvCell(Joined(cell.Texts("algorithm"))), CsvCell(Joined(cell.Texts("recipe"))),
      CsvCell(Joined(cell.Texts("source"))), DataColumns(cell), Mean(score, 2),
      Deviation(score, seeds, 2), Mean(episode_return, 1), Deviation(episode_return, seeds, 1),
      seeds, Range(cell.Counts("updates")), settled, CsvCell(Joined(cell.Texts("precision"))),
      Mean(hours, 2), Mean(cell.Figures("simulator_steps", "ledger"), 0),
      Mean(cell.Figures("query_rows", "ledger"), 0),
      Mean(cell.Figures("dataset_rows", "ledger"), 0), cell.IsEntry(published) ? "yes" : "no");
}

}  // namespace

Result<std::string> Leaderboard(const std::string& results_folder,
                                const std::vector<Benchmark>& benchmarks,
                                const PublishedDatasets& published,
                                std::vector<std::string>* skipped) {
  B4MRL_ASSIGN_OR_RETURN(const auto files, FilesIn(FolderOfResults(results_folder), ".json"));
  if (files.empty()) {
    return Status(StatusCode::kIoError, fmt::format("{} holds no results", results_folder));
  }
  std::map<std::string_view, const Benchmark*> known;
  for (const Benchmark& benchmark : benchmarks) known.emplace(benchmark.name, &benchmark);
  std::vector<Json> results;
  std::vector<std::string> paths;
  for (const std::string& file : files) {
    auto json = ReadJsonObject(file);
    if (!json.ok() && skipped != nullptr) skipped->push_back(json.status().message());
    if (!json.ok() || !IsTrue(*json, "finished")) continue;
    ReplaceControls(&*json);
    results.push_back(Needed(*json, KnownBenchmarks(*json, file, known, skipped)));
    paths.push_back(file);
  }
  const auto copies = CopiedSeeds(results, paths);
  std::set<const Json*> copied;
  for (size_t i = 0; i < results.size(); ++i) {
    if (copies[i].empty()) continue;
    copied.insert(&results[i]);
    if (skipped != nullptr) skipped->push_back(fmt::format("{}: {}", paths[i], copies[i].front()));
  }
  // A result names the benchmarks that its own plan knew: a cell fills those that one of its names.
  std::map<std::string, std::set<std::string>> filled;
  for (const Json& result : results) {
    std::set<std::string>& names = filled[CellKey(result)];
    for (std::string& name : TextsOf(result, "benchmarks")) names.insert(std::move(name));
  }
  std::map<std::string, std::map<std::string, Cell>> cells;
  for (const Json& result : results) {
    const std::string key = CellKey(result);
    for (const std::string& name : filled[key]) {
      Cell& cell = cells[name][key];
      const bool is_copy = copied.contains(&result);
      if (!is_copy) cell.Add(&result);
      cell.has_copies |= is_copy;
    }
  }
  std::string csv =
      "benchmark,algorithm,recipe,source,dataset,rows,rows_sha256,score,score_std,return,return_"
      "std,"
      "seeds,updates,settled,precision,core_hours,simulator_steps,query_rows,dataset_rows,entry\n";
  for (const Benchmark& benchmark : benchmarks) {
    const auto found = cells.find(benchmark.name);
    if (found == cells.end()) continue;
    std::vector<const Cell*> ranked;
    for (const auto& [id, cell] : found->second) {
      if (!cell.results.empty()) ranked.push_back(&cell);
    }
    std::ranges::stable_sort(ranked, std::ranges::greater(), [](const Cell* cell) {
      return cell->Figures("return").value_or(MeanAndStd()).mean;
    });
    for (const Cell* cell : ranked) csv += RowOf(benchmark.name, *cell, published);
  }
  return csv;
}

}  // namespace b4mrl

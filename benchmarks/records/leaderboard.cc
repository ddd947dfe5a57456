#include "benchmarks/records/leaderboard.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <system_error>
#include <utility>

#include "benchmarks/records/json_file.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

// What an entry asks for (benchmarks/RULES.md).
constexpr uint64_t kSeedsOfAnEntry[] = {0, 1, 2};
constexpr size_t kEpisodesOfAnEntry = 10;

// Results of one cell.
struct Cell {
  std::vector<const Json*> results;

  // The mean over the results that have the number; nothing where one lacks it.
  std::optional<double> Mean(std::string_view key, std::string_view inside = "") const {
    double sum = 0;
    for (const Json* result : results) {
      const auto number = NumberOf(inside.empty() ? *result : EntryOf(*result, inside), key);
      if (!number) return std::nullopt;
      sum += *number;
    }
    return sum / static_cast<double>(results.size());
  }
  double Deviation(std::string_view key) const {
    const double mean = Mean(key).value_or(0);
    double squares = 0;
    for (const Json* result : results) {
      const double difference = NumberOf(*result, key).value_or(mean) - mean;
      squares += difference * difference;
    }
    return std::sqrt(squares / static_cast<double>(results.size()));
  }
  std::set<std::string> Texts(std::string_view key, std::string_view inside = "") const {
    std::set<std::string> texts;
    for (const Json* result : results) {
      texts.insert(TextOf(inside.empty() ? *result : EntryOf(*result, inside), key));
    }
    return texts;
  }
  bool IsEntry() const {
    std::set<uint64_t> seeds, updates;
    for (const Json* result : results) {
      seeds.insert(CountOf(*result, "seed").value_or(0));
      updates.insert(CountOf(*result, "updates").value_or(0));
    }
    const bool has_episodes = std::ranges::all_of(results, [](const Json* result) {
      return EntryOf(*result, "returns").size() >= kEpisodesOfAnEntry;
    });
    return std::ranges::all_of(kSeedsOfAnEntry, [&](uint64_t s) { return seeds.contains(s); }) &&
           seeds.size() == results.size() && updates.size() == 1 && has_episodes &&
           !Texts("source").contains("self-scored") && Texts("precision").size() == 1;
  }
};

std::string Joined(const std::set<std::string>& texts) {
  return fmt::format("{}", fmt::join(texts, "+"));
}

std::string Shown(const std::optional<double>& number, int digits) {
  return number ? fmt::format("{:.{}f}", *number, digits) : "";
}

std::string RowOf(const std::string& benchmark, const Cell& cell) {
  const bool has_score = cell.Mean("score").has_value();
  const bool all_settled = std::ranges::all_of(
      cell.results, [](const Json* result) { return IsTrue(*result, "settled"); });
  const auto seconds = cell.Mean("seconds");
  return fmt::format(
      "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", benchmark,
      Joined(cell.Texts("algorithm")), Joined(cell.Texts("recipe")), Joined(cell.Texts("source")),
      Shown(cell.Mean("score"), 2), has_score ? Shown(cell.Deviation("score"), 2) : "",
      Shown(cell.Mean("return"), 1), Shown(cell.Deviation("return"), 1), cell.results.size(),
      Shown(cell.Mean("updates"), 0), all_settled ? "yes" : "no", Joined(cell.Texts("precision")),
      Shown(seconds ? std::optional(*seconds / 3600) : std::nullopt, 2),
      Shown(cell.Mean("simulator_steps", "ledger"), 0), Shown(cell.Mean("query_rows", "ledger"), 0),
      Shown(cell.Mean("dataset_rows", "ledger"), 0), cell.IsEntry() ? "yes" : "no");
}

}  // namespace

Result<std::string> Leaderboard(const std::string& results_folder,
                                const std::vector<Benchmark>& benchmarks) {
  std::vector<std::string> files;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(results_folder, error), end;
       !error && entry != end; entry.increment(error)) {
    if (entry->path().extension() == ".json") files.push_back(entry->path());
  }
  if (error) return IoError("list", results_folder, error.value());
  std::ranges::sort(files);
  std::vector<Json> results;
  for (const std::string& file : files) {
    auto json = ReadJsonObject(file);
    if (json.ok() && IsTrue(*json, "finished")) results.push_back(*std::move(json));
  }
  // By benchmark, then by cell and by the data, as other rows are another cell.
  std::map<std::string, std::map<std::string, Cell>> cells;
  for (const Json& result : results) {
    for (const Json& name : EntryOf(result, "benchmarks")) {
      if (!name.is_string()) continue;
      const std::string data = TextOf(EntryOf(result, "dataset"), "columns_sha256");
      cells[name.get<std::string>()][TextOf(result, "cell") + data].results.push_back(&result);
    }
  }
  std::string csv =
      "benchmark,algorithm,recipe,source,score,score_std,return,return_std,seeds,updates,settled,"
      "precision,core_hours,simulator_steps,query_rows,dataset_rows,entry\n";
  for (const Benchmark& benchmark : benchmarks) {
    const auto found = cells.find(benchmark.name);
    if (found == cells.end()) continue;
    std::vector<const Cell*> ranked;
    for (const auto& [id, cell] : found->second) ranked.push_back(&cell);
    std::ranges::stable_sort(ranked, [](const Cell* one, const Cell* other) {
      return one->Mean("return").value_or(0) > other->Mean("return").value_or(0);
    });
    for (const Cell* cell : ranked) csv += RowOf(benchmark.name, *cell);
  }
  return csv;
}

}  // namespace b4mrl

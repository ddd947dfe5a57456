#include "algorithms/run/metrics_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <utility>

#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

struct LogNames {
  std::string_view name, tag, column;
};

// Event-file tags and progress.csv columns of some metrics. Any other metric becomes
// "charts/<name>" and "rollout/<rest>" if it begins with "rollout_", otherwise "losses/<name>" and
// "train/<name>".
constexpr LogNames kNames[] = {
    {"update", "charts/update", "train/n_updates"},
    {"environment_steps", "charts/environment_steps", "time/total_timesteps"},
    {"seconds", "charts/seconds", "time/time_elapsed"},
    {"updates_per_second", "charts/updates_per_second", "time/updates_per_second"},
    {"episodic_return", "charts/episodic_return", "rollout/ep_rew_mean"},
    {"evaluation_return", "charts/evaluation_return", "eval/mean_reward"},
    {"evaluation_return_std", "charts/evaluation_return_std", "eval/std_reward"},
    {"evaluation_score", "charts/evaluation_score", "eval/score"},
    {"simulator_steps", "ledger/simulator_steps", "ledger/simulator_steps"},
    {"query_rows", "ledger/query_rows", "ledger/query_rows"},
    {"dataset_rows", "ledger/dataset_rows", "ledger/dataset_rows"},
    {"evaluation_episodes", "ledger/evaluation_episodes", "ledger/evaluation_episodes"},
    {"alpha", "losses/alpha", "train/ent_coef"},
    {"alpha_loss", "losses/alpha_loss", "train/ent_coef_loss"},
};

constexpr std::string_view kRollout = "rollout_";

const LogNames* FindNames(std::string_view name) {
  const auto* found = std::find_if(std::begin(kNames), std::end(kNames),
                                   [&](const LogNames& names) { return names.name == name; });
  return found == std::end(kNames) ? nullptr : found;
}

// Formats whole numbers without a fraction, and other numbers with the digits of a float.
std::string FormatValue(double value) {
  if (value == std::floor(value) && std::abs(value) < 1e15) return fmt::format("{:.0f}", value);
  return fmt::format("{:.9g}", value);
}

// Parses a line of metrics.jsonl as Write writes it; returns an empty row for other lines.
MetricRow ParseLine(const std::string& line) {
  MetricRow row;
  const auto json = nlohmann::ordered_json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) return row;
  for (const auto& [name, value] : json.items()) {
    if (value.is_number()) row.push_back({name, value.get<double>()});
  }
  return row;
}

// Calls `use` with each row of metrics.jsonl.
Status ForEachRow(const std::string& path, const std::function<Status(const MetricRow&)>& use) {
  std::ifstream lines(path);
  for (std::string line; std::getline(lines, line);) {
    B4MRL_RETURN_IF_ERROR(use(ParseLine(line)));
  }
  const bool is_read = lines.is_open() && !lines.bad();
  return is_read ? Status() : Status(StatusCode::kIoError, fmt::format("cannot read {}", path));
}

}  // namespace

std::string TagOf(std::string_view name) {
  const LogNames* names = FindNames(name);
  if (names != nullptr) return std::string(names->tag);
  return fmt::format("{}/{}", name.starts_with(kRollout) ? "charts" : "losses", name);
}

std::string ColumnOf(std::string_view name) {
  const LogNames* names = FindNames(name);
  if (names != nullptr) return std::string(names->column);
  if (name.starts_with(kRollout)) return fmt::format("rollout/{}", name.substr(kRollout.size()));
  return fmt::format("train/{}", name);
}

Result<MetricsLog> MetricsLog::Open(const std::string& folder, const Offsets& offsets) {
  const std::string json_path = folder + "/metrics.jsonl";
  const std::string events_path = folder + "/events.out.tfevents.b4mrl";
  // Neither is cut for a checkpoint that the other does not fit.
  B4MRL_RETURN_IF_ERROR(AppendedFile::Check(json_path, offsets.json_bytes));
  B4MRL_RETURN_IF_ERROR(AppendedFile::Check(events_path, offsets.event_bytes));
  B4MRL_ASSIGN_OR_RETURN(AppendedFile json, AppendedFile::Open(json_path, offsets.json_bytes));
  B4MRL_ASSIGN_OR_RETURN(EventFile events, EventFile::Open(events_path, offsets.event_bytes));
  MetricsLog log(folder, std::move(json), std::move(events));
  B4MRL_RETURN_IF_ERROR(ForEachRow(log.JsonPath(), [&](const MetricRow& row) {
    log.AddColumns(row);
    return Status();
  }));
  B4MRL_RETURN_IF_ERROR(log.RewriteTable());
  return log;
}

bool MetricsLog::AddColumns(const MetricRow& row) {
  const size_t before = columns_.size();
  for (const Metric& metric : row) {
    const bool known = std::find(columns_.begin(), columns_.end(), metric.name) != columns_.end();
    if (!known) columns_.push_back(metric.name);
  }
  return columns_.size() > before;
}

std::string MetricsLog::TableLine(const MetricRow& row) const {
  std::string line;
  for (const std::string& column : columns_) {
    const auto metric =
        std::find_if(row.begin(), row.end(), [&](const Metric& m) { return m.name == column; });
    if (&column != &columns_.front()) line += ",";
    if (metric != row.end()) line += FormatValue(metric->value);
  }
  return line + "\n";
}

Status MetricsLog::RewriteTable() {
  std::string header;
  for (const std::string& column : columns_) {
    header += (header.empty() ? "" : ",") + ColumnOf(column);
  }
  uint64_t bytes = 0;
  B4MRL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(TablePath()));
  const auto append = [&](const std::string& line) {
    bytes += line.size();
    return file.Write(line);
  };
  if (!header.empty()) B4MRL_RETURN_IF_ERROR(append(header + "\n"));
  B4MRL_RETURN_IF_ERROR(
      ForEachRow(JsonPath(), [&](const MetricRow& row) { return append(TableLine(row)); }));
  B4MRL_RETURN_IF_ERROR(file.Commit());
  B4MRL_ASSIGN_OR_RETURN(table_, AppendedFile::Open(TablePath(), bytes));
  return Status();
}

Status MetricsLog::Write(const MetricRow& row) {
  MetricRow measured;
  for (const Metric& metric : row) {
    if (std::isfinite(metric.value)) measured.push_back(metric);
  }
  if (measured.empty()) return Status();
  std::string json;
  MetricRow tagged;
  for (const Metric& metric : measured) {
    json +=
        fmt::format("{}\"{}\":{}", json.empty() ? "" : ",", metric.name, FormatValue(metric.value));
    if (metric.name != "update") tagged.push_back({TagOf(metric.name), metric.value});
  }
  B4MRL_RETURN_IF_ERROR(json_.Append("{" + json + "}\n"));
  B4MRL_RETURN_IF_ERROR(events_.Write(static_cast<int64_t>(measured.front().value), tagged));
  B4MRL_RETURN_IF_ERROR(AddColumns(measured) ? RewriteTable()
                                             : table_->Append(TableLine(measured)));
  written_ = Present();
  return Status();
}

Status MetricsLog::Sync() {
  B4MRL_RETURN_IF_ERROR(json_.Sync());
  return events_.Sync();
}

}  // namespace b4mrl

#include "algorithms/rl/metrics.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <limits>
#include <span>

#include "data/atomic_file.h"

namespace b4mrl {
namespace {

Result<UniqueFd> OpenLog(const std::string& path, uint64_t offset) {
  const int create = offset == 0 ? O_TRUNC : 0;
  UniqueFd fd(open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | create, 0644));
  if (!fd.valid()) return IoError("open", path, errno);
  const off_t end = lseek(fd.get(), 0, SEEK_END);
  if (end < static_cast<off_t>(offset)) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("{} has {} bytes, the checkpoint says {}", path, end, offset));
  }
  if (ftruncate(fd.get(), static_cast<off_t>(offset)) != 0) return IoError("cut", path, errno);
  if (lseek(fd.get(), static_cast<off_t>(offset), SEEK_SET) < 0)
    return IoError("seek", path, errno);
  return fd;
}

Status WriteLine(const UniqueFd& fd, const std::string& line, std::string_view path,
                 uint64_t& offset) {
  B4MRL_RETURN_IF_ERROR(WriteFully(fd.get(), std::as_bytes(std::span(line)), path));
  offset += line.size();
  return Status();
}

// Whole numbers without a fraction; everything else with the digits that a float carries.
std::string FormatValue(double value) {
  if (std::isnan(value)) return "";
  if (value == std::floor(value) && std::abs(value) < 1e15) return fmt::format("{:.0f}", value);
  return fmt::format("{:.9g}", value);
}

}  // namespace

MetricMeans::Sum& MetricMeans::SumOf(std::string_view name) {
  auto sum = std::find_if(sums_.begin(), sums_.end(), [&](const Sum& s) { return s.name == name; });
  if (sum == sums_.end()) sum = sums_.insert(sums_.end(), {std::string(name)});
  return *sum;
}

void MetricMeans::Add(std::string_view name, double value) { AddAll(name, {&value, 1}); }

void MetricMeans::AddAll(std::string_view name, std::span<const double> values) {
  Sum& sum = SumOf(name);
  for (const double value : values) {
    if (!std::isfinite(value) && !first_nonfinite_) first_nonfinite_ = {std::string(name), value};
    sum.sum += value;
    ++sum.count;
  }
}

MetricRow MetricMeans::Take() {
  MetricRow row;
  for (Sum& sum : sums_) {
    const double mean =
        sum.count > 0 ? sum.sum / sum.count : std::numeric_limits<double>::quiet_NaN();
    row.push_back({sum.name, mean});
    sum.sum = 0;
    sum.count = 0;
  }
  return row;
}

void MetricMeans::Save(CheckpointWriter& writer) const {
  writer.Integer("metrics/count", static_cast<int64_t>(sums_.size()));
  for (size_t i = 0; i < sums_.size(); ++i) {
    writer.Text(fmt::format("metrics/{}/name", i), sums_[i].name);
    writer.Number(fmt::format("metrics/{}/sum", i), sums_[i].sum);
    writer.Integer(fmt::format("metrics/{}/values", i), sums_[i].count);
  }
}

void MetricMeans::Load(CheckpointReader& reader) {
  sums_.clear();
  const int64_t count = reader.Integer("metrics/count");
  for (int64_t i = 0; i < count && reader.status().ok(); ++i) {
    sums_.push_back({reader.Text(fmt::format("metrics/{}/name", i)),
                     reader.Number(fmt::format("metrics/{}/sum", i)),
                     reader.Integer(fmt::format("metrics/{}/values", i))});
  }
}

Result<MetricsLog> MetricsLog::Open(const std::string& folder, const Offsets& offsets) {
  B4MRL_ASSIGN_OR_RETURN(UniqueFd csv, OpenLog(folder + "/progress.csv", offsets.csv_bytes));
  B4MRL_ASSIGN_OR_RETURN(UniqueFd json, OpenLog(folder + "/metrics.jsonl", offsets.json_bytes));
  return MetricsLog(std::move(csv), std::move(json), offsets);
}

Status MetricsLog::Write(const MetricRow& row) {
  std::string names, values, json;
  for (const Metric& metric : row) {
    const std::string value = FormatValue(metric.value);
    const std::string_view comma = &metric == &row.front() ? "" : ",";
    names += fmt::format("{}{}", comma, metric.name);
    values += fmt::format("{}{}", comma, value);
    if (std::isfinite(metric.value)) {
      json += fmt::format("{}\"{}\":{}", json.empty() ? "" : ",", metric.name, value);
    }
  }
  std::string lines = offsets_.csv_bytes == 0 ? names + "\n" : "";
  lines += values + "\n";
  B4MRL_RETURN_IF_ERROR(WriteLine(csv_, lines, "progress.csv", offsets_.csv_bytes));
  return WriteLine(json_, "{" + json + "}\n", "metrics.jsonl", offsets_.json_bytes);
}

Status MetricsLog::Sync() {
  if (fsync(csv_.get()) != 0) return IoError("sync", "progress.csv", errno);
  if (fsync(json_.get()) != 0) return IoError("sync", "metrics.jsonl", errno);
  return Status();
}

}  // namespace b4mrl

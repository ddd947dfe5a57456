#include "benchmarks/runner/dataset_jobs.h"

#include <fmt/format.h>

#include <algorithm>

#include "benchmarks/runner/run_folder.h"
#include "data/files/atomic_file.h"

namespace b4mrl {

Result<std::vector<UsedDataset>> DatasetJobs::ListUsed() const {
  B4MRL_ASSIGN_OR_RETURN(const auto listed, client_.ListDatasets());
  std::vector<UsedDataset> used;
  for (const pb::DatasetInfo& one : listed) {
    used.push_back({one.name(), one.rows(), one.sha256(), one.columns_sha256()});
  }
  return used;
}

Result<std::optional<UsedDataset>> DatasetJobs::Find(const std::string& full_name) const {
  B4MRL_ASSIGN_OR_RETURN(const auto listed, ListUsed());
  const auto found = std::ranges::find(listed, full_name, &UsedDataset::name);
  return found == listed.end() ? std::nullopt : std::optional(*found);
}

Result<std::optional<UsedDataset>> DatasetJobs::FindCounted(const std::string& full_name) const {
  B4MRL_ASSIGN_OR_RETURN(auto found, Find(full_name));
  if (!found || !found->columns_sha256.empty()) return found;
  B4MRL_RETURN_IF_ERROR(client_.OpenDataset(full_name).status());
  return Find(full_name);
}

Result<std::optional<UsedDataset>> DatasetJobs::LearnedFrom(const PlannedRun& run) const {
  if (run.dataset.empty()) return std::optional<UsedDataset>();
  B4MRL_ASSIGN_OR_RETURN(auto dataset, FindCounted(run.full_dataset));
  if (dataset) return dataset;
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("{} is gone, so the result of {} cannot say what it learned from",
                            run.full_dataset, run.name));
}

void DatasetJobs::NoteRowsAtHand(bool counts, std::vector<PlannedRun>* plan) const {
  const auto listed = ListUsed();
  if (!listed.ok()) return;                  // nothing is known
  std::map<std::string, std::string> known;  // hashes by full name
  for (const UsedDataset& dataset : *listed) known[dataset.name] = dataset.columns_sha256;
  for (PlannedRun& run : *plan) {
    const auto entry = known.find(run.full_dataset);
    if (entry == known.end()) continue;
    if (counts && entry->second.empty()) {
      const auto counted = FindCounted(run.full_dataset);
      if (counted.ok() && *counted) entry->second = (*counted)->columns_sha256;
    }
    run.rows_at_hand = entry->second;
  }
}

std::string DatasetJobs::WayOut(const PlannedRun& run) const {
  std::string command = fmt::format("b4mrl dataset make {} --replace", run.dataset);
  if (run.rows) command += fmt::format(" --rows {}", *run.rows);
  for (const std::string& word : place_.daemon_words) command += " " + word;
  const bool is_own = place_.daemon_words.empty() || place_.daemon_words.front() == "--data";
  return fmt::format("make it again ({}){}", command,
                     is_own ? ", or choose another --data-folder" : "");
}

std::string DatasetJobs::Refusal(const PlannedRun& run, const UsedDataset& dataset) const {
  const std::string way_out = WayOut(run);
  const bool is_counted = dataset.rows > 0;
  if (is_counted && run.rows && dataset.rows != *run.rows) {
    return fmt::format("{} in {} has {} rows, not the {} of this run; {}", dataset.name,
                       place_.data_folder, dataset.rows, *run.rows, way_out);
  }
  const bool is_hashed = !dataset.columns_sha256.empty();
  if (is_hashed && !run.columns_sha256.empty() && dataset.columns_sha256 != run.columns_sha256) {
    return fmt::format("{} in {} has {} rows that are not the published ones; {}", dataset.name,
                       place_.data_folder, dataset.rows, way_out);
  }
  return "";
}

std::optional<std::string> DatasetJobs::Failure(const std::string& full_name) const {
  const auto found = attempts_.find(full_name);
  if (found == attempts_.end() || found->second < kMostAttempts) return std::nullopt;
  return CouldNotBeMade(full_name);
}

std::string DatasetJobs::CouldNotBeMade(const std::string& full_name) const {
  return fmt::format("dataset {} could not be made, see {}.log", full_name,
                     DatasetStem(place_.folder, full_name));
}

Result<std::set<std::string>> DatasetJobs::Refusals(const std::vector<PlannedRun>& plan) const {
  B4MRL_ASSIGN_OR_RETURN(const auto listed, ListUsed());
  std::set<std::string> refusals;
  for (const PlannedRun& run : plan) {
    const auto found = std::ranges::find(listed, run.full_dataset, &UsedDataset::name);
    if (found == listed.end()) continue;
    if (std::string refusal = Refusal(run, *found); !refusal.empty()) refusals.insert(refusal);
  }
  return refusals;
}

Result<std::optional<Job>> DatasetJobs::Begin(const PlannedRun& run) {
  const std::string stem = DatasetStem(place_.folder, run.full_dataset);
  B4MRL_ASSIGN_OR_RETURN(UniqueFd claim, Claim(stem + ".claim"));
  if (!claim.valid() || IsMadeElsewhere(run.full_dataset)) return std::optional<Job>();
  std::vector<std::string> words = {"dataset", "make", run.full_dataset, "--quiet"};
  words.insert(words.end(), place_.daemon_words.begin(), place_.daemon_words.end());
  if (place_.makes_own_rows && run.rows) {
    words.insert(words.end(), {"--rows", fmt::format("{}", *run.rows)});
  }
  B4MRL_ASSIGN_OR_RETURN(Job job, Job::Start(ToolOrder(words, stem + ".log"), std::move(claim)));
  return std::optional(std::move(job));
}

std::optional<std::string> DatasetJobs::Finish(const std::string& full_name, int exit_code) {
  if (exit_code == 0 || IsMadeElsewhere(full_name)) return std::nullopt;
  const auto found = Find(full_name);
  if (found.ok() && *found) return std::nullopt;  // another process was quicker
  const bool again = ++attempts_[full_name] < kMostAttempts;
  return CouldNotBeMade(full_name) + (again ? "; again later" : "");
}

bool DatasetJobs::IsMadeElsewhere(const std::string& full_name) const {
  // The data folder of a daemon on another machine is not there, and nobody writes in it here.
  return IsBeingWritten(fmt::format("{}/{}.h5", place_.data_folder, full_name));
}

}  // namespace b4mrl

#include "server/datasets/served_datasets.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {

std::shared_ptr<const Dataset> ServedDatasets::Find(const std::string& fingerprint) {
  const auto found = served_.find(fingerprint);
  if (found == served_.end()) return nullptr;
  found->second.used = Clock::now();
  return found->second.dataset;
}

void ServedDatasets::Add(const std::string& fingerprint, std::shared_ptr<const Dataset> dataset) {
  served_[fingerprint] = {std::move(dataset), Clock::now()};
  if (served_.size() <= limits::kMaxMappedDatasets) return;
  served_.erase(
      std::ranges::min_element(served_, {}, [](const auto& entry) { return entry.second.used; }));
}

void ServedDatasets::Add(const OpenedDataset& opened) {
  if (opened.source != nullptr) Add(opened.source_fingerprint, opened.source);
  if (opened.dataset != nullptr) Add(opened.fingerprint, opened.dataset);
}

void ServedDatasets::ReleaseIdle() {
  constexpr std::chrono::minutes kBetweenLooks{1}, kIdle{5};
  const Clock::time_point now = Clock::now();
  if (now - looked_ < kBetweenLooks) return;
  looked_ = now;
  std::erase_if(served_, [&](const auto& entry) { return now - entry.second.used > kIdle; });
}

}  // namespace b4mrl

// The datasets that a dataset worker has mapped for its clients. A dataset that no client uses is
// unmapped, because a mapped cache cannot be removed when other caches need the room. Thread rule:
// one thread.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "data/columns/dataset.h"
#include "proto/base/clock.h"
#include "server/datasets/dataset_store.h"

namespace b4mrl {

class ServedDatasets {
 public:
  // Null if no dataset of that fingerprint is mapped here. Counts as a use.
  std::shared_ptr<const Dataset> Find(const std::string& fingerprint);
  // Above limits::kMaxMappedDatasets, drops the dataset that was used longest ago.
  void Add(const std::string& fingerprint, std::shared_ptr<const Dataset> dataset);
  // Of what was opened, the dataset and the one that it is derived from: opening another one
  // derived from that need not read it again.
  void Add(const OpenedDataset& opened);
  // Drops the datasets that were not used for five minutes. Looks at most once a minute.
  void ReleaseIdle();

 private:
  struct Served {
    std::shared_ptr<const Dataset> dataset;
    Clock::time_point used;  // time of its last use
  };
  std::map<std::string, Served> served_;
  Clock::time_point looked_ = Clock::now();
};

}  // namespace b4mrl

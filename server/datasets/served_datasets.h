// The datasets that a dataset worker has mapped for its clients. What nobody uses is let go: while
// it is mapped its cache must stay, though others may need the room. One thread.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "data/columns/dataset.h"
#include "proto/base/clock.h"

namespace b4mrl {

class ServedDatasets {
 public:
  // Null if it is not among them.
  std::shared_ptr<const Dataset> Find(const std::string& fingerprint);
  // Lets go the one that was used longest ago when there are more than limits::kMaxMappedDatasets.
  void Add(const std::string& fingerprint, std::shared_ptr<const Dataset> dataset);
  // Lets go what nobody has used for five minutes; looks once a minute at most.
  void ReleaseIdle();

 private:
  struct Served {
    std::shared_ptr<const Dataset> dataset;
    uint64_t last_use = 0;  // in the order of uses
    Clock::time_point used;
  };
  std::map<std::string, Served> served_;
  uint64_t uses_ = 0;
  Clock::time_point looked_ = Clock::now();
};

}  // namespace b4mrl

// Which requests the scans of a folder answer.
//
// A scan looks at every file, so there is one at a time, and all requests that wait join the next
// one. One that comes while a scan runs waits for the next: that scan may have passed a file which
// the client has written before it asked. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

namespace b4mrl {

class JoinedScans {
 public:
  struct Owner {
    // Whether the request has yet to be answered; it is not at its deadline.
    std::function<bool(uint64_t id)> waits;
    // Begins a scan that answers these requests, and calls EndScan later.
    std::function<void(std::vector<uint64_t> ids)> scan;
  };
  explicit JoinedScans(Owner owner) : owner_(std::move(owner)) {}

  // A request that waits joins the next scan. The owner bounds how many wait.
  void Join(uint64_t id) {
    std::erase_if(next_, [this](uint64_t other) { return !owner_.waits(other); });
    next_.push_back(id);
    BeginScan();
  }
  void EndScan() {
    scanning_ = false;
    std::erase_if(next_, [this](uint64_t id) { return !owner_.waits(id); });
    BeginScan();
  }

 private:
  void BeginScan() {
    if (scanning_ || next_.empty()) return;
    scanning_ = true;
    owner_.scan(std::exchange(next_, {}));
  }

  Owner owner_;
  bool scanning_ = false;
  std::vector<uint64_t> next_;
};

}  // namespace b4mrl

// Who drives in front of and behind a car on each lane. Positions do not change while the drivers
// of one frame decide, so cars are sorted once a frame and each question is a search in bits.
// Memory is taken at construction. One thread.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "server/highway/settings.h"
#include "server/highway/traffic.h"

namespace b4mrl {

class Neighbours {
 public:
  explicit Neighbours(size_t capacity);

  // Looks at where the cars of `traffic` are; it and its positions stay while questions are asked.
  void Update(const Traffic& traffic, int lanes);

  // The next car at or ahead of `vehicle`'s x among all others on `lane`, with a margin of 1 m, or
  // kNoVehicle. Of several at the same x the last in the list.
  int Front(int vehicle, int lane) const;
  // The next car behind its x; of several the first in the list.
  int Rear(int vehicle, int lane) const;

 private:
  static constexpr size_t kWords = kMaxVehicles / 64;
  using RankSet = std::array<uint64_t, kWords>;

  void Sort();
  // The rules above, read literally; for cars at equal x.
  int ScanFront(int vehicle, int lane) const;
  int ScanRear(int vehicle, int lane) const;
  bool IsOn(int vehicle, int lane) const {
    return on_lane_[static_cast<size_t>(lane)][rank_[vehicle] / 64] >> (rank_[vehicle] % 64) & 1;
  }

  const Traffic* traffic_ = nullptr;
  std::vector<int> by_rank_;  // cars by increasing x
  std::vector<unsigned> rank_;
  std::array<RankSet, kMaxRoadLanes> on_lane_{};  // the ranks of the cars on a lane
  bool ties_ = false;                             // two cars have the same x
};

}  // namespace b4mrl

// Finds the cars in front of and behind a car on each lane. Positions do not change while the
// drivers of one frame decide, so the cars are sorted once a frame and each search scans a bit set.
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

  // Sorts the cars of `traffic`. It must neither change nor be destroyed before the last call of
  // Front and Rear.
  void Update(const Traffic& traffic, int lanes);

  // The next car at or ahead of `vehicle`'s x among all others on `lane`, with a margin of 1 m, or
  // kNoVehicle. Of several cars at the same x the last in the list.
  int Front(int vehicle, int lane) const;
  // The next car behind the x of `vehicle`, found as in Front. Of several cars at the same x the
  // first in the list.
  int Rear(int vehicle, int lane) const;

 private:
  static constexpr size_t kWords = kMaxVehicles / 64;
  using RankSet = std::array<uint64_t, kWords>;

  void Sort();
  // Front and Rear without the sorted order, for when several cars are at the same x.
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

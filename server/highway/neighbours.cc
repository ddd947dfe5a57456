#include "server/highway/neighbours.h"

#include <bit>
#include <limits>
#include <numeric>

#include "server/highway/road.h"

namespace b4mrl {

Neighbours::Neighbours(size_t capacity) : by_rank_(capacity), rank_(capacity) {}

// Insertion sort: an episode starts with the cars in the order of x, and cars overtake rarely.
void Neighbours::Sort() {
  const int count = traffic_->count;
  const double* x = traffic_->x.data();
  std::iota(by_rank_.begin(), by_rank_.begin() + count, 0);
  for (int i = 1; i < count; ++i) {
    const int vehicle = by_rank_[i];
    int place = i;
    for (; place > 0 && x[by_rank_[place - 1]] > x[vehicle]; --place) {
      by_rank_[place] = by_rank_[place - 1];
    }
    by_rank_[place] = vehicle;
  }
}

void Neighbours::Update(const Traffic& traffic, int lanes) {
  traffic_ = &traffic;
  Sort();
  for (int lane = 0; lane < lanes; ++lane) on_lane_[static_cast<size_t>(lane)] = {};
  ties_ = false;
  double behind = -std::numeric_limits<double>::infinity();
  for (unsigned rank = 0; rank < static_cast<unsigned>(traffic.count); ++rank) {
    const int vehicle = by_rank_[rank];
    const double x = traffic.x[vehicle];
    const double y = traffic.y[vehicle];
    rank_[vehicle] = rank;
    ties_ |= x == behind;
    behind = x;
    const size_t word = rank / 64;
    for (int lane = 0; lane < lanes; ++lane) {
      const uint64_t on = OnLane(x, y, lane, 1);
      on_lane_[static_cast<size_t>(lane)][word] |= on << (rank % 64);
    }
  }
}

int Neighbours::Front(int vehicle, int lane) const {
  if (ties_) return ScanFront(vehicle, lane);
  const RankSet& ranks = on_lane_[static_cast<size_t>(lane)];
  const unsigned next = rank_[vehicle] + 1;
  uint64_t mask = ~uint64_t{0} << (next % 64);
  for (size_t word = next / 64; word < kWords; ++word, mask = ~uint64_t{0}) {
    const uint64_t ahead = ranks[word] & mask;
    if (ahead != 0) return by_rank_[word * 64 + static_cast<size_t>(std::countr_zero(ahead))];
  }
  return kNoVehicle;
}

int Neighbours::Rear(int vehicle, int lane) const {
  if (ties_) return ScanRear(vehicle, lane);
  const RankSet& ranks = on_lane_[static_cast<size_t>(lane)];
  uint64_t mask = (uint64_t{1} << (rank_[vehicle] % 64)) - 1;
  for (size_t word = rank_[vehicle] / 64 + 1; word-- > 0; mask = ~uint64_t{0}) {
    const uint64_t behind = ranks[word] & mask;
    if (behind != 0) {
      return by_rank_[word * 64 + 63 - static_cast<size_t>(std::countl_zero(behind))];
    }
  }
  return kNoVehicle;
}

int Neighbours::ScanFront(int vehicle, int lane) const {
  const double* x = traffic_->x.data();
  int front = kNoVehicle;
  for (int other = 0; other < traffic_->count; ++other) {
    if (other == vehicle || !IsOn(other, lane) || !(x[vehicle] <= x[other])) continue;
    if (front == kNoVehicle || x[other] <= x[front]) front = other;
  }
  return front;
}

int Neighbours::ScanRear(int vehicle, int lane) const {
  const double* x = traffic_->x.data();
  int rear = kNoVehicle;
  for (int other = 0; other < traffic_->count; ++other) {
    if (other == vehicle || !IsOn(other, lane) || !(x[other] < x[vehicle])) continue;
    if (rear == kNoVehicle || x[other] > x[rear]) rear = other;
  }
  return rear;
}

}  // namespace b4mrl

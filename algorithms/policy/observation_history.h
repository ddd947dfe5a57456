// The last `length` observations of each lane, stacked: the input of a policy with a history.
//
// A column of view() holds one lane's observations, oldest first: length * size numbers. After a
// reset the episode's first observation fills all places. Thread rule: one thread.
#pragma once

#include <algorithm>
#include <span>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

class ObservationHistory {
 public:
  ObservationHistory(int length, int observation_size, int lanes)
      : length_(length), size_(observation_size), stacked_(length * observation_size, lanes) {}

  void Reset(int lane, std::span<const float> observation) {
    float* column = stacked_.view().column(lane);
    for (int i = 0; i < length_; ++i) {
      std::copy_n(observation.data(), size_, column + i * size_);
    }
  }
  void Push(int lane, std::span<const float> observation) {
    float* column = stacked_.view().column(lane);
    std::copy(column + size_, column + length_ * size_, column);
    std::copy_n(observation.data(), size_, column + (length_ - 1) * size_);
  }
  MatrixView<const float> view() const { return stacked_.view(); }
  std::span<const float> lane(int index) const {
    return {stacked_.view().column(index), static_cast<size_t>(length_) * size_};
  }
  // The numbers of all lanes, which a checkpoint stores.
  std::span<float> values() { return stacked_.values(); }

 private:
  int length_;
  int size_;
  MatrixBuffer<float> stacked_;
};

}  // namespace b4mrl

// A core's whole state as plain data: what a checkpoint holds, for tests of resumption.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "algorithms/nn/parameters.h"

namespace b4mrl {

template <typename Scalar>
struct CoreState {
  std::map<std::string, std::vector<Scalar>> arrays;
  std::map<std::string, int64_t> counters;
  bool operator==(const CoreState&) const = default;
};

template <typename Scalar, typename Core>
CoreState<Scalar> SaveState(Core& core) {
  CoreState<Scalar> state;
  core.VisitArrays([&](const NamedArray<Scalar>& array) {
    state.arrays[array.name].assign(array.values.begin(), array.values.end());
  });
  core.VisitCounters(
      [&](const NamedCounter& counter) { state.counters[counter.name] = *counter.value; });
  return state;
}

template <typename Scalar, typename Core>
void LoadState(const CoreState<Scalar>& state, Core& core) {
  core.VisitArrays([&](const NamedArray<Scalar>& array) {
    const std::vector<Scalar>& values = state.arrays.at(array.name);
    std::copy(values.begin(), values.end(), array.values.begin());
  });
  core.VisitCounters(
      [&](const NamedCounter& counter) { *counter.value = state.counters.at(counter.name); });
}

}  // namespace b4mrl

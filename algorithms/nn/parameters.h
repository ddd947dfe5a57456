// Names for the numbers of a learner, so that writing and reading a checkpoint are one loop each.
//
// A core (algorithms/cores) or ensemble (algorithms/model) hands every array that must survive a
// restart to a visitor: parameters, targets and Adam's moments. Arrays keep name, shape and order
// for the life of the core, and their spans stay valid until it is moved or destroyed, so the same
// visit writes and reads. Counters are whole numbers, visited apart from the arrays.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace b4mrl {

template <typename Scalar>
struct NamedArray {
  std::string name;        // "critic/layer0/weight", "actor/adam/first_moment", ...
  std::vector<int> shape;  // row-major; a weight is (members, outputs, inputs), or without members
  std::span<Scalar> values;
};

template <typename Scalar>
using ArrayVisitor = std::function<void(const NamedArray<Scalar>&)>;

struct NamedCounter {
  std::string name;
  int64_t* value;
};
using CounterVisitor = std::function<void(const NamedCounter&)>;

}  // namespace b4mrl

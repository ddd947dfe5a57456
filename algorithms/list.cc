#include "algorithms/list.h"

#include <vector>

// One line for each learner's file in learners/: LINE(Sac) stands for SacAlgorithm() of sac.cc.
#define B4MRL_ALGORITHMS(LINE) \
  LINE(Sac)                    \
  LINE(Td3)                    \
  LINE(Bc)                     \
  LINE(Td3Bc)                  \
  LINE(Iql)                    \
  LINE(Mopo)                   \
  LINE(H2o)                    \
  LINE(Hymopo)

namespace b4mrl {

#define B4MRL_DECLARE(name) Algorithm name##Algorithm();
B4MRL_ALGORITHMS(B4MRL_DECLARE)

std::span<const Algorithm> Algorithms() {
#define B4MRL_CALL(name) name##Algorithm(),
  static const Algorithm kAlgorithms[] = {B4MRL_ALGORITHMS(B4MRL_CALL)};
  return kAlgorithms;
}

Result<const Algorithm*> FindAlgorithm(std::string_view name) {
  std::vector<std::string_view> names;
  for (const Algorithm& algorithm : Algorithms()) {
    if (algorithm.name == name) return &algorithm;
    names.push_back(algorithm.name);
  }
  return UnknownName("algorithm", name, names);
}

}  // namespace b4mrl

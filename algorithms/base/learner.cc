#include "algorithms/base/learner.h"

namespace b4mrl {

std::vector<float> LearnerContext::ActionScale() const {
  std::vector<float> scale;
  for (const DimensionSpec& dimension : environment.action.dimensions) {
    scale.push_back(static_cast<float>(dimension.high));
  }
  return scale;
}

}  // namespace b4mrl

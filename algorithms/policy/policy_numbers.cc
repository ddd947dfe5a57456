#include "algorithms/policy/policy_numbers.h"

#include <algorithm>

namespace b4mrl {
namespace {

// Every number of `policy` in order.
template <typename Policy, typename Visitor>
void VisitVectors(Policy& policy, const Visitor& visit) {
  for (auto& layer : policy.hidden) {
    visit(layer.weight);
    visit(layer.bias);
  }
  visit(policy.mean.weight);
  visit(policy.mean.bias);
  if (policy.log_std) {
    visit(policy.log_std->weight);
    visit(policy.log_std->bias);
  }
}

}  // namespace

std::vector<float> FlattenPolicy(const PolicyWeights& policy) {
  std::vector<float> numbers;
  VisitVectors(policy, [&](const std::vector<float>& values) {
    numbers.insert(numbers.end(), values.begin(), values.end());
  });
  return numbers;
}

bool UnflattenPolicy(std::span<const float> numbers, PolicyWeights& policy) {
  size_t size = 0;
  VisitVectors(policy, [&](const std::vector<float>& values) { size += values.size(); });
  if (size != numbers.size()) return false;
  VisitVectors(policy, [&](std::vector<float>& values) {
    std::copy_n(numbers.begin(), values.size(), values.begin());
    numbers = numbers.subspan(values.size());
  });
  return true;
}

}  // namespace b4mrl

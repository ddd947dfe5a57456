#include "server/replies/environment_info.h"

namespace b4mrl {
namespace {

void DescribeSpace(const SpaceSpec& space, pb::Space* out) {
  for (const uint64_t extent : space.shape) out->add_shape(extent);
  for (const DimensionSpec& dimension : space.dimensions) {
    pb::Dimension* target = out->add_dimensions();
    target->set_name(dimension.name);
    target->set_unit(dimension.unit);
    target->set_low(dimension.low);
    target->set_high(dimension.high);
    target->set_feature(dimension.feature);
  }
}

}  // namespace

void FillEnvironmentInfo(const EnvironmentSpec& spec, pb::EnvironmentInfo* out) {
  out->set_name(spec.name);
  DescribeSpace(spec.observation, out->mutable_observation());
  DescribeSpace(spec.action, out->mutable_action());
  out->set_reward(spec.reward);
  out->set_max_episode_steps(spec.max_episode_steps);
  out->set_step_seconds(spec.step_seconds);
  if (spec.reference_min) out->set_reference_min(*spec.reference_min);
  if (spec.reference_max) out->set_reference_max(*spec.reference_max);
  for (const std::string& name : spec.info_names) out->add_info_names(name);
  for (const std::string& name : spec.reset_info_names) out->add_reset_info_names(name);
  out->set_picture_width(spec.picture_width);
  out->set_picture_height(spec.picture_height);
  if (!spec.termination) return;
  pb::TerminationRule* rule = out->mutable_termination();
  for (const DimensionBounds& bounds : *spec.termination) {
    pb::DimensionBounds* target = rule->add_bounds();
    target->set_dimension(bounds.dimension);
    target->set_low(bounds.low);
    target->set_high(bounds.high);
    target->set_inclusive(bounds.inclusive);
  }
}

}  // namespace b4mrl

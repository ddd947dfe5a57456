#include "server/gateway/describe.h"

#include <fmt/format.h>

#include "proto/base/limits.h"
#include "proto/base/version.h"
#include "server/environments/list.h"

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

void DescribeServer(int64_t lease_ms, pb::HelloReply* out) {
  out->set_protocol_version(limits::kProtocolVersion);
  out->set_server_version(std::string(ServerVersion()));
  out->set_engine_version(EngineVersion());
  out->set_architecture("x86_64");
  for (const char* capability :
       {"step", "query", "snapshot", "render", "datasets", "status", "relay"}) {
    out->add_capabilities(capability);
  }
  pb::Limits* bounds = out->mutable_limits();
  bounds->set_max_envelope_bytes(limits::kMaxEnvelopeBytes);
  bounds->set_max_payload_bytes(limits::kMaxPayloadBytes);
  bounds->set_max_sessions(limits::kMaxSessions);
  bounds->set_max_lanes_per_session(limits::kMaxLanesPerSession);
  bounds->set_max_requests_in_flight(limits::kMaxRequestsInFlight);
  bounds->set_max_query_rows(limits::kMaxQueryRows);
  bounds->set_max_rows_per_batch(limits::kMaxRowsPerBatch);
  bounds->set_session_lease_ms(static_cast<uint64_t>(lease_ms));
}

void DescribeEnvironment(const EnvironmentSpec& spec, pb::EnvironmentInfo* out) {
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
}

void DescribeSession(const Session& session, pb::AttachReply* out) {
  DescribeEnvironment(session.simulator().spec(), out->mutable_info());
  for (const NamedArgument& item : session.simulator().resolved_perturbations()) {
    pb::NamedArgument* target = out->add_perturbations();
    target->set_name(item.name);
    target->set_argument(item.argument);
  }
  out->set_config(session.simulator().config_json());
  out->set_experiment_id(session.experiment_id());
}

void DescribeOpen(const pb::OpenRequest& request, const pb::AttachReply& session,
                  pb::OpenReply* out) {
  out->set_environment(request.environment());
  *out->mutable_perturbations() = session.perturbations();
  out->set_num_envs(request.num_envs());
  out->set_seed(request.seed());
  out->set_autoreset_mode(request.autoreset_mode());
  out->set_observation_dtype(request.observation_dtype());
  out->set_with_infos(request.with_infos());
  out->set_config(session.config());
  *out->mutable_info() = session.info();
  out->set_experiment_id(session.experiment_id());
}

Status VersionMismatch(uint32_t version) {
  return Status(StatusCode::kVersionMismatch,
                fmt::format("protocol version {} was sent, this server ({}) speaks {}", version,
                            ServerVersion(), limits::kProtocolVersion));
}

std::string_view ServerVersion() { return ProjectVersion(); }

}  // namespace b4mrl

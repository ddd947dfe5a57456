#include "server/gateway/describe.h"

#include "proto/base/limits.h"
#include "proto/base/version.h"
#include "server/environments/mujoco/engine_version.h"

namespace b4mrl {
void DescribeServer(int64_t lease_ms, bool has_doors, pb::HelloReply* out) {
  out->set_protocol_version(limits::kProtocolVersion);
  out->set_server_version(std::string(ProjectVersion()));
  out->set_engine_version(EngineVersion());
  out->set_architecture("x86_64");
  for (const char* capability :
       {"step", "query", "snapshot", "render", "datasets", "status", "relay", "ledger"}) {
    out->add_capabilities(capability);
  }
  if (has_doors) out->add_capabilities("door");
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

}  // namespace b4mrl

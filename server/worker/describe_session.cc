#include "server/worker/describe_session.h"

#include "proto/wire/named_arguments.h"
#include "server/replies/environment_info.h"

namespace b4mrl {

void DescribeSession(const Session& session, pb::AttachReply* out) {
  FillEnvironmentInfo(session.simulator().spec(), out->mutable_info());
  AddNamedArguments(session.simulator().resolved_perturbations(), out->mutable_perturbations());
  out->set_config(session.simulator().config_json());
  out->set_experiment_id(session.experiment_id());
}

}  // namespace b4mrl

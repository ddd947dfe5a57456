#include "server/worker/describe_session.h"

#include "server/replies/environment_info.h"

namespace b4mrl {

void DescribeSession(const Session& session, pb::AttachReply* out) {
  FillEnvironmentInfo(session.simulator().spec(), out->mutable_info());
  for (const NamedArgument& item : session.simulator().resolved_perturbations()) {
    pb::NamedArgument* target = out->add_perturbations();
    target->set_name(item.name);
    target->set_argument(item.argument);
  }
  out->set_config(session.simulator().config_json());
  out->set_experiment_id(session.experiment_id());
}

}  // namespace b4mrl

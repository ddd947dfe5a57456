#include "server/datasets/dataset_replies.h"

#include <fmt/format.h>

#include <string>

#include "proto/base/limits.h"
#include "proto/wire/named_arguments.h"
#include "server/datasets/provenance_json.h"

namespace b4mrl {
namespace {

// Bytes for the entries of a page, and bytes for the tag and length of each entry.
constexpr size_t kMaxListBytes = limits::kMaxEnvelopeBytes - 1024, kFieldBytes = 4;
void FillInfo(const DatasetFileInfo& info, pb::DatasetInfo* out) {
  out->set_name(info.name);
  out->set_rows(info.rows);
  out->set_file_bytes(info.file_bytes);
  out->set_sha256(info.sha256);
  out->set_behaviour_policy(PlainPolicy(info.behaviour_policy));
  out->set_columns_sha256(info.columns_sha256);
}

void FillProvenance(const DatasetProvenance& provenance, pb::DatasetProvenance* out) {
  out->set_name(provenance.name);
  out->set_environment(provenance.environment);
  out->set_simulator(provenance.simulator);
  for (const uint32_t dimension : provenance.hidden_dimensions) {
    out->add_hidden_dimensions(dimension);
  }
  out->set_history_length(provenance.history_length);
  out->set_recipe(provenance.recipe);
  for (const RecordedPart& part : provenance.parts) {
    pb::RecordedPart* added = out->add_parts();
    added->set_policy(part.policy);
    added->set_policy_sha256(part.policy_sha256);
    added->set_seed(part.seed);
    added->set_rows(part.rows);
  }
  out->set_engine(provenance.engine);
  out->set_program(provenance.program);
  out->set_command(provenance.command);
  out->set_license(provenance.license);
}

}  // namespace

void FillList(const std::vector<DatasetFileInfo>& list, uint32_t first,
              pb::ListDatasetsReply* out) {
  out->set_total(static_cast<uint32_t>(list.size()));
  size_t bytes = 0;
  for (size_t i = first; i < list.size(); ++i) {
    pb::DatasetInfo* info = out->add_datasets();
    FillInfo(list[i], info);
    bytes += info->ByteSizeLong() + kFieldBytes;
    if (bytes <= kMaxListBytes) continue;
    out->mutable_datasets()->RemoveLast();
    return;
  }
}

Result<DatasetRequest> ReadOpen(const pb::OpenDatasetRequest& request) {
  B4MRL_ASSIGN_OR_RETURN(const TransitionRule rule, ParseTransitionRule(request.transition_rule()));
  if (request.corruptions_size() > static_cast<int>(limits::kMaxPerturbations)) {
    return InvalidNumber("number of corruptions", request.corruptions_size(),
                         fmt::format("0..{}", limits::kMaxPerturbations));
  }
  return DatasetRequest{request.dataset(), NamedArgumentsOf(request.corruptions()), request.seed(),
                        rule, request.environment()};
}

void FillOpened(const OpenedDataset& opened, pb::OpenDatasetReply* out) {
  out->set_fingerprint(opened.fingerprint);
  FillInfo(opened.info, out->mutable_info());
  out->set_rows(opened.dataset->rows());
  out->set_observation_size(opened.dataset->columns().observation_size);
  out->set_action_size(opened.dataset->columns().action_size);
  AddNamedArguments(opened.corruptions, out->mutable_corruptions());
  for (const uint32_t dimension : opened.hidden_dimensions) out->add_hidden_dimensions(dimension);
  out->set_environment(opened.environment);
  out->set_seed(opened.seed);
  out->set_transition_rule(std::string(TransitionRuleName(opened.rule)));
  FillProvenance(opened.provenance, out->mutable_provenance());
}

}  // namespace b4mrl

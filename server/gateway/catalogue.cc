#include "server/gateway/catalogue.h"

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <utility>

#include "proto/b4mrl.pb.h"
#include "proto/base/limits.h"
#include "server/environments/list.h"
#include "server/models/model_compiler.h"
#include "server/perturbations/list.h"
#include "server/replies/environment_info.h"

namespace b4mrl {
namespace {

// A folder's time of change is this coarse at worst: what is younger may yet change unseen.
constexpr auto kSettled = std::chrono::seconds(2);

void DescribePerturbation(const PerturbationEntry& entry, pb::PerturbationInfo* out) {
  out->set_name(std::string(entry.name));
  out->set_parameter(std::string(entry.parameter));
  out->set_type(std::string(entry.type));
  out->set_low(entry.low);
  out->set_high(entry.high);
  out->set_description(std::string(entry.description));
  out->set_corrupts_datasets(entry.corrupts_datasets);
  for (const EnvironmentEntry& environment : EnvironmentList()) {
    const Result<EnvironmentSpec> spec = DescribeEnvironment(environment.name);
    if (spec.ok() && Applies(entry, *spec)) out->add_environments(spec->name);
  }
  for (const PerturbationPreset& preset : PresetList()) {
    if (preset.parametric != entry.name) continue;
    pb::PresetInfo* target = out->add_presets();
    target->set_name(std::string(preset.name));
    target->set_environment(std::string(preset.environment));
    target->set_argument(std::string(preset.argument));
  }
}

// An environment that cannot be described is left out.
void DescribeCatalogue(const std::vector<std::string>& model_files, pb::CatalogueReply* out) {
  for (const EnvironmentEntry& entry : EnvironmentList()) {
    const Result<EnvironmentSpec> spec = DescribeEnvironment(entry.name);
    if (spec.ok()) FillEnvironmentInfo(*spec, out->add_environments());
  }
  for (const PerturbationEntry& entry : PerturbationList()) {
    pb::PerturbationInfo* info = out->add_perturbations();
    DescribePerturbation(entry, info);
    if (entry.type == "file") info->mutable_files()->Assign(model_files.begin(), model_files.end());
  }
}

}  // namespace

Result<Frame> Catalogue::Envelope(uint64_t request_id) {
  ReadFolder();
  // Fields may come in any order, and concatenated messages are merged.
  pb::Reply id;
  id.set_request_id(request_id);
  const std::string first = id.SerializeAsString();
  const size_t size = first.size() + serialised_.size();
  if (size > limits::kMaxEnvelopeBytes) {
    return InvalidNumber("bytes of the catalogue", static_cast<double>(size),
                         "at most " + std::to_string(limits::kMaxEnvelopeBytes));
  }
  Frame envelope = Frame::OfSize(size);
  std::memcpy(envelope.data(), first.data(), first.size());
  std::memcpy(envelope.data() + first.size(), serialised_.data(), serialised_.size());
  return envelope;
}

void Catalogue::ReadFolder() {
  using std::chrono::nanoseconds;
  struct stat info {};
  nanoseconds changed{0};  // of a folder that is not there
  if (stat(models_folder_.c_str(), &info) == 0) {
    changed = std::chrono::seconds(info.st_mtim.tv_sec) + nanoseconds(info.st_mtim.tv_nsec);
  }
  if (folder_changed_ns_ == changed.count()) return;
  const nanoseconds now = std::chrono::system_clock::now().time_since_epoch();
  folder_changed_ns_.reset();
  if (changed + kSettled < now) folder_changed_ns_ = changed.count();
  std::vector<std::string> files = ListModelFiles(models_folder_);
  if (files == files_ && !serialised_.empty()) return;
  files_ = std::move(files);
  Serialise();
}

void Catalogue::Serialise() {
  pb::Reply reply;
  reply.set_protocol_version(limits::kProtocolVersion);
  reply.mutable_status();
  DescribeCatalogue(files_, reply.mutable_catalogue());
  serialised_ = reply.SerializeAsString();
}

}  // namespace b4mrl

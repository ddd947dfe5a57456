#include "server/gateway/catalogue.h"

#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <chrono>
#include <utility>

#include "server/environments/list.h"
#include "server/models/model_compiler.h"
#include "server/perturbations/list.h"
#include "server/replies/environment_info.h"

namespace b4mrl {
namespace {

// The worst resolution of a file system's times of change: a folder that changed more recently may
// change again without showing a later time.
constexpr auto kSettled = std::chrono::seconds(2);
// Bytes of a reply's envelope beside its entries: version, id, status, total and lengths.
constexpr size_t kEnvelopeRest = 64;

void DescribePerturbation(const PerturbationEntry& entry, pb::PerturbationInfo* out) {
  out->set_name(std::string(entry.name));
  out->set_parameter(std::string(entry.parameter));
  out->set_type(std::string(entry.type));
  out->set_low(entry.low);
  out->set_high(entry.high);
  out->set_description(std::string(entry.description));
  out->set_corrupts_datasets(entry.corrupts_datasets);
  out->set_takes_range(entry.takes_range);
  for (const EnvironmentEntry& environment : EnvironmentList()) {
    const Result<EnvironmentSpec> spec = DescribeEnvironment(environment.name);
    if (spec.ok() && Applies(entry, *spec)) out->add_environments(spec->name);
  }
  for (const Preset& preset : PresetList()) {
    if (preset.parametric != entry.name) continue;
    pb::PresetInfo* target = out->add_presets();
    target->set_name(std::string(preset.name));
    target->set_environment(std::string(preset.environment));
    target->set_argument(std::string(preset.argument));
  }
}

}  // namespace

Catalogue::Catalogue(std::string models_folder, size_t page_bytes)
    : models_folder_(std::move(models_folder)), page_bytes_(page_bytes - kEnvelopeRest) {}

void Catalogue::FillPage(uint32_t first, pb::Reply* reply) {
  ReadFolder();
  pb::CatalogueReply head;
  head.set_total(static_cast<uint32_t>(entries_.size()));
  std::string page;
  for (size_t i = first; i < entries_.size(); ++i) {
    if (page.size() + entries_[i].size() > page_bytes_) break;
    page += entries_[i];
  }
  // Parsers merge concatenated messages, so the entries can stand beside the total as they are.
  page += head.SerializeAsString();
  reply->GetReflection()->MutableUnknownFields(reply)->AddLengthDelimited(
      pb::Reply::kCatalogueFieldNumber, page);
}

void Catalogue::ReadFolder() {
  using std::chrono::nanoseconds;
  struct stat info {};
  nanoseconds changed{0};  // stays 0 if there is no such folder
  if (stat(models_folder_.c_str(), &info) == 0) {
    changed = std::chrono::seconds(info.st_mtim.tv_sec) + nanoseconds(info.st_mtim.tv_nsec);
  }
  if (folder_changed_ns_ == changed.count()) return;
  const nanoseconds now = std::chrono::system_clock::now().time_since_epoch();
  folder_changed_ns_.reset();
  if (changed + kSettled < now) folder_changed_ns_ = changed.count();
  std::vector<std::string> files = ListModelFiles(models_folder_);
  if (files == files_ && !entries_.empty()) return;
  files_ = std::move(files);
  Serialise();
}

void Catalogue::Serialise() {
  entries_.clear();
  const auto add = [this](const std::string& name, const pb::CatalogueReply& entry) {
    std::string bytes = entry.SerializeAsString();
    if (bytes.size() <= page_bytes_) return entries_.push_back(std::move(bytes));
    spdlog::error("the catalogue leaves out {}: its description has {} bytes", name, bytes.size());
  };
  for (const EnvironmentEntry& environment : EnvironmentList()) {
    const Result<EnvironmentSpec> spec = DescribeEnvironment(environment.name);
    if (!spec.ok()) continue;  // leaves out an environment that cannot be described
    pb::CatalogueReply entry;
    FillEnvironmentInfo(*spec, entry.add_environments());
    add(spec->name, entry);
  }
  for (const PerturbationEntry& perturbation : PerturbationList()) {
    pb::CatalogueReply entry;
    pb::PerturbationInfo* info = entry.add_perturbations();
    DescribePerturbation(perturbation, info);
    if (perturbation.type == "file") info->mutable_files()->Assign(files_.begin(), files_.end());
    add(info->name(), entry);
  }
}

}  // namespace b4mrl

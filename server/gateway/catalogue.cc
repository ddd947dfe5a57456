#include "server/gateway/catalogue.h"

#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <ctime>
#include <optional>
#include <utility>

#include "server/environments/list.h"
#include "server/models/model_compiler.h"
#include "server/perturbations/list.h"
#include "server/replies/environment_info.h"

namespace b4mrl {
namespace {

// The worst resolution of a file system's times of change: a folder that changed more recently may
// change again without showing a later time.
constexpr int64_t kSettledSeconds = 2;
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

void DescribeBenchmark(const Benchmark& benchmark, pb::BenchmarkInfo* out) {
  out->set_name(benchmark.name);
  out->set_suite(benchmark.suite);
  out->set_environment(benchmark.environment);
  out->set_challenge(benchmark.challenge);
  out->set_simulator(benchmark.simulator);
  out->set_dataset(benchmark.dataset);
  out->set_corruption(benchmark.corruption);
  out->set_world(benchmark.world);
  out->mutable_algorithms()->Assign(benchmark.algorithms.begin(), benchmark.algorithms.end());
  out->mutable_exceptions()->Assign(benchmark.exceptions.begin(), benchmark.exceptions.end());
  for (const auto& [name, value] : benchmark.hyperparameters) {
    pb::Hyperparameter* hyperparameter = out->add_hyperparameters();
    hyperparameter->set_name(name);
    hyperparameter->set_value(value);
  }
  for (const auto& [algorithm, score] : benchmark.paper) {
    pb::PaperScore* printed = out->add_paper();
    printed->set_algorithm(algorithm);
    printed->set_mean(score.mean);
    printed->set_std(score.std);
  }
}

// The models of a folder, which is listed anew unless its time of change shows that the list is
// right.
class ModelList {
 public:
  explicit ModelList(std::string folder) : folder_(std::move(folder)) {}

  std::vector<std::string> Read() {
    struct stat info {};
    if (stat(folder_.c_str(), &info) != 0) info = {};  // there is no such folder
    const std::pair<int64_t, int64_t> changed = {info.st_mtim.tv_sec, info.st_mtim.tv_nsec};
    if (changed_ == changed) return files_;
    changed_.reset();
    if (changed.first < time(nullptr) - kSettledSeconds) changed_ = changed;
    return files_ = ListModelFiles(folder_);
  }

 private:
  const std::string folder_;
  std::vector<std::string> files_;
  // The folder's change (seconds, nanoseconds) when files_ was read; unset if it may be outdated.
  std::optional<std::pair<int64_t, int64_t>> changed_;
};

}  // namespace

Catalogue::Catalogue(const std::string& models_folder,
                     std::function<std::vector<Benchmark>()> read_benchmarks, size_t page_bytes)
    : models_folder_([list = ModelList(models_folder)]() mutable { return list.Read(); }),
      page_bytes_(page_bytes - kEnvelopeRest),
      read_benchmarks_(std::move(read_benchmarks)) {}

void Catalogue::FillPage(const pb::CatalogueRequest& request, pb::Reply* reply) {
  ReadFolder();
  if (request.with_benchmarks() && read_benchmarks_) SerialiseBenchmarks();
  const size_t total = entries_.size() + (request.with_benchmarks() ? benchmarks_.size() : 0);
  pb::CatalogueReply head;
  head.set_total(static_cast<uint32_t>(total));
  std::string page;
  for (size_t i = request.first(); i < total; ++i) {
    const std::string& entry = i < entries_.size() ? entries_[i] : benchmarks_[i - entries_.size()];
    if (page.size() + entry.size() > page_bytes_) break;
    page += entry;
  }
  // Parsers merge concatenated messages, so the entries can stand beside the total as they are.
  page += head.SerializeAsString();
  reply->GetReflection()->MutableUnknownFields(reply)->AddLengthDelimited(
      pb::Reply::kCatalogueFieldNumber, page);
}

void Catalogue::ReadFolder() {
  std::vector<std::string> files = models_folder_.Latest();
  if (files == files_ && !entries_.empty()) return;
  files_ = std::move(files);
  Serialise();
}

void Catalogue::SerialiseBenchmarks() {
  for (const Benchmark& benchmark : std::exchange(read_benchmarks_, nullptr)()) {
    pb::CatalogueReply entry;
    DescribeBenchmark(benchmark, entry.add_benchmarks());
    Add(benchmark.name, entry, &benchmarks_);
  }
}

void Catalogue::Add(const std::string& name, const pb::CatalogueReply& entry,
                    std::vector<std::string>* entries) const {
  std::string bytes = entry.SerializeAsString();
  if (bytes.size() <= page_bytes_) return entries->push_back(std::move(bytes));
  spdlog::error("the catalogue leaves out {}: its description has {} bytes", name, bytes.size());
}

void Catalogue::Serialise() {
  entries_.clear();
  for (const EnvironmentEntry& environment : EnvironmentList()) {
    const Result<EnvironmentSpec> spec = DescribeEnvironment(environment.name);
    if (!spec.ok()) continue;  // leaves out an environment that cannot be described
    pb::CatalogueReply entry;
    FillEnvironmentInfo(*spec, entry.add_environments());
    Add(spec->name, entry, &entries_);
  }
  for (const PerturbationEntry& perturbation : PerturbationList()) {
    pb::CatalogueReply entry;
    pb::PerturbationInfo* info = entry.add_perturbations();
    DescribePerturbation(perturbation, info);
    if (perturbation.type == "file") info->mutable_files()->Assign(files_.begin(), files_.end());
    Add(info->name(), entry, &entries_);
  }
}

}  // namespace b4mrl

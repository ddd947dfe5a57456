#include "server/perturbations/perturbation.h"

#include <string_view>

namespace b4mrl {
namespace {

std::string_view KindName(DrawContext::Kind kind) {
  switch (kind) {
    case DrawContext::Kind::kEpisode:
      return "episode";
    case DrawContext::Kind::kQuery:
      return "query";
    case DrawContext::Kind::kDataset:
      return "dataset";
    case DrawContext::Kind::kDatasetLastRow:
      return "dataset-last-row";
  }
  return "";
}

}  // namespace

Rng RowRng(const DrawContext& context, std::string_view purpose, uint64_t occurrence,
           uint64_t per_row) {
  const uint64_t seed =
      MixSeeds(MixSeeds(context.seed, HashName(KindName(context.kind))), occurrence);
  Rng rng(seed, purpose, context.major);
  rng.Seek(context.minor * per_row);
  return rng;
}

PerturbationSet::PerturbationSet(const EnvironmentSpec& spec,
                                 std::vector<std::unique_ptr<Perturbation>> members)
    : members_(std::move(members)) {
  for (const auto& member : members_) {
    state_sizes_.push_back(member->state_size(spec));
    state_size_ += state_sizes_.back();
  }
}

std::vector<NamedArgument> PerturbationSet::items() const {
  std::vector<NamedArgument> items;
  for (const auto& member : members_) items.push_back(member->ToNamedArgument());
  return items;
}

std::vector<const Perturbation*> PerturbationSet::members() const {
  std::vector<const Perturbation*> pointers;
  for (const auto& member : members_) pointers.push_back(member.get());
  return pointers;
}

void PerturbationSet::OnOptions(Config& config) const {
  for (const auto& member : members_) member->OnOptions(config);
}

std::string PerturbationSet::model_file() const {
  std::string file;
  for (const auto& member : members_) {
    if (!member->model_file().empty()) file = member->model_file();
  }
  return file;
}

Status PerturbationSet::OnModel(mjModel_* model) const {
  for (const auto& member : members_) B4MRL_RETURN_IF_ERROR(member->OnModel(model));
  return Status();
}

void PerturbationSet::OnAction(const DrawContext& context, std::span<double> state,
                               std::span<double> action) const {
  size_t offset = 0;
  for (size_t i = 0; i < members_.size(); ++i) {
    members_[i]->OnAction(context, state.subspan(offset, state_sizes_[i]), action);
    offset += state_sizes_[i];
  }
}

void PerturbationSet::OnObservation(const DrawContext& context,
                                    std::span<double> observation) const {
  for (const auto& member : members_) member->OnObservation(context, observation);
}

}  // namespace b4mrl

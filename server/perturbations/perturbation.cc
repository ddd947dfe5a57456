#include "server/perturbations/perturbation.h"

#include <fmt/format.h>

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

bool HasRange(const Perturbation& perturbation) {
  return perturbation.number() != nullptr && perturbation.number()->is_range;
}

}  // namespace

double NumberArgument::Draw(const DrawContext& context, std::string_view purpose) const {
  Rng rng = RowRng(context, purpose, /*occurrence=*/0, /*per_row=*/1);
  if (!whole) return rng.Uniform(low, high);
  return low + static_cast<double>(rng.Below(static_cast<uint64_t>(high - low) + 1));
}

std::string NumberArgument::ToString() const {
  return is_range ? fmt::format("{}..{}", low, high) : fmt::format("{}", low);
}

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
    keeps_float32_ = keeps_float32_ && member->keeps_float32();
    if (HasRange(*member)) parameter_names_.push_back(member->ToNamedArgument().name);
  }
}

std::vector<NamedArgument> PerturbationSet::items() const {
  std::vector<NamedArgument> items;
  for (const auto& member : members_) items.push_back(member->ToNamedArgument());
  return items;
}

std::vector<double> PerturbationSet::LargestParameters() const {
  std::vector<double> parameters;
  for (const auto& member : members_) {
    if (HasRange(*member)) parameters.push_back(member->number()->high);
  }
  return parameters;
}

void PerturbationSet::DrawParameters(const DrawContext& context,
                                     std::span<double> parameters) const {
  DrawContext drawn = context;
  if (context.kind == DrawContext::Kind::kEpisode) drawn.minor = 0;  // one draw for all steps
  size_t at = 0;
  for (const auto& member : members_) {
    if (!HasRange(*member)) continue;
    parameters[at] = member->number()->Draw(drawn, parameter_names_[at]);
    ++at;
  }
}

std::vector<double> PerturbationSet::NumbersInForce(std::span<const double> parameters) const {
  std::vector<double> numbers;
  size_t at = 0;
  for (const auto& member : members_) {
    const double fixed = member->number() == nullptr ? 0 : member->number()->low;
    numbers.push_back(HasRange(*member) ? parameters[at++] : fixed);
  }
  return numbers;
}

void PerturbationSet::OnOptions(std::span<const double> parameters, Config& config) const {
  const std::vector<double> numbers = NumbersInForce(parameters);
  for (size_t i = 0; i < members_.size(); ++i) members_[i]->OnOptions(config, numbers[i]);
}

std::string PerturbationSet::model_file() const {
  std::string file;
  for (const auto& member : members_) {
    if (!member->model_file().empty()) file = member->model_file();
  }
  return file;
}

Status PerturbationSet::OnModel(std::span<const double> parameters, mjModel_* model) const {
  const std::vector<double> numbers = NumbersInForce(parameters);
  for (size_t i = 0; i < members_.size(); ++i) {
    B4MRL_RETURN_IF_ERROR(members_[i]->OnModel(model, numbers[i]));
  }
  return Status();
}

template <typename Function>
void PerturbationSet::ForEach(std::span<double> state, Function function) const {
  size_t offset = 0;
  for (size_t i = 0; i < members_.size(); ++i) {
    function(*members_[i], state.subspan(offset, state_sizes_[i]));
    offset += state_sizes_[i];
  }
}

void PerturbationSet::OnAction(const DrawContext& context, std::span<double> state,
                               std::span<double> action) const {
  ForEach(state, [&](const Perturbation& member, std::span<double> part) {
    member.OnAction(context, part, action);
  });
}

void PerturbationSet::OnReward(const DrawContext& context, std::span<double> state,
                               double& reward) const {
  ForEach(state, [&](const Perturbation& member, std::span<double> part) {
    member.OnReward(context, part, reward);
  });
}

void PerturbationSet::OnObservation(const DrawContext& context, std::span<double> state,
                                    std::span<double> observation) const {
  ForEach(state, [&](const Perturbation& member, std::span<double> part) {
    member.OnObservation(context, part, observation);
  });
}

}  // namespace b4mrl

#include "server/datasets/provenance_json.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <string_view>

namespace b4mrl {
namespace {

using Json = nlohmann::json;

constexpr size_t kMaxPolicyBytes = 200;

constexpr char kLicense[] = "license";

bool Take(const Json& json, std::string_view name, std::string* out) {
  const Json value = json.value(name, Json());
  if (value.is_string()) *out = value.get<std::string>();
  return value.is_string();
}

template <typename T>
bool Take(const Json& value, T* out) {
  if (!value.is_number_unsigned()) return false;
  const uint64_t number = value.get<uint64_t>();
  if (number > std::numeric_limits<T>::max()) return false;
  *out = static_cast<T>(number);
  return true;
}

bool TakePart(const Json& json, RecordedPart* part) {
  return json.is_object() && Take(json, "policy", &part->policy) &&
         Take(json, "policy_sha256", &part->policy_sha256) &&
         Take(json.value("seed", Json()), &part->seed) &&
         Take(json.value("rows", Json()), &part->rows);
}

// Reads every element of an array by `take`.
template <typename T, typename TakeOne>
bool TakeAll(const Json& array, std::vector<T>* out, TakeOne take) {
  if (!array.is_array()) return false;
  for (const Json& element : array) {
    if (!take(element, &out->emplace_back())) return false;
  }
  return true;
}

}  // namespace

std::string PlainText(const std::string& text, size_t max_bytes) {
  std::string plain = text.substr(0, max_bytes);
  std::ranges::replace_if(
      plain, [](char c) { return c < ' ' || c > '~'; }, '?');
  return plain;
}

std::string PlainPolicy(const std::string& text) { return PlainText(text, kMaxPolicyBytes); }

Json ToJson(const DatasetProvenance& provenance) {
  Json json = {{"hidden_dimensions", provenance.hidden_dimensions},
               {"history_length", provenance.history_length},
               {"parts", Json::array()}};
  json[kLicense] = PlainText(provenance.license, kMaxProvenanceText);
  for (const ProvenanceText& entry : kProvenanceTexts) {
    json[std::string(entry.name)] = PlainText(provenance.*entry.text, kMaxProvenanceText);
  }
  for (const RecordedPart& part : provenance.parts) {
    json["parts"].push_back({{"policy", PlainText(part.policy, kMaxProvenanceText)},
                             {"policy_sha256", part.policy_sha256},
                             {"seed", part.seed},
                             {"rows", part.rows}});
  }
  return json;
}

Result<DatasetProvenance> ProvenanceOf(const Json& json) {
  DatasetProvenance provenance;
  bool complete = json.is_object() &&
                  Take(json.value("history_length", Json()), &provenance.history_length) &&
                  TakeAll(json.value("hidden_dimensions", Json()), &provenance.hidden_dimensions,
                          Take<uint32_t>) &&
                  TakeAll(json.value("parts", Json()), &provenance.parts, TakePart);
  complete = complete && Take(json, kLicense, &provenance.license);
  for (const ProvenanceText& entry : kProvenanceTexts) {
    complete = complete && Take(json, entry.name, &(provenance.*entry.text));
  }
  if (complete && provenance.Validate().ok()) return provenance;
  return Status(StatusCode::kDataLoss, "a dataset's provenance cannot be read");
}

}  // namespace b4mrl

#include "data/minari/minari_metadata.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "data/d4rl/agent_file.h"
#include "data/minari/episode_lengths.h"
#include "proto/base/limits.h"
#include "proto/wire/json_depth.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

// The readers of Minari 0.5.0 and later accept this version, and no earlier version has the layout.
constexpr char kMinariVersion[] = "0.5.0";

constexpr size_t kMaxIdBytes = 256;  // of the ids of a dataset and an environment that are kept

struct TextEntry {
  const char* name;
  std::string DatasetProvenance::*text;
};
// What a daemon tells of the origin of a dataset, but for its name, which is Minari's own entry.
constexpr TextEntry kExportedTexts[] = {
    {"environment", &DatasetProvenance::environment}, {"simulator", &DatasetProvenance::simulator},
    {"recipe", &DatasetProvenance::recipe},           {"engine", &DatasetProvenance::engine},
    {"program", &DatasetProvenance::program},         {"license", &DatasetProvenance::license},
};

std::string Dump(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

// A number as Python's json module writes it: infinities are words that JSON itself does not have.
std::string NumberText(double value) {
  if (std::isinf(value)) return value > 0 ? "Infinity" : "-Infinity";
  return Dump(value);
}

// The space as Minari's serialize_space writes it.
std::string BoxText(const SpaceSpec& space) {
  std::string low, high;
  for (const DimensionSpec& dimension : space.dimensions) {
    const char* separator = low.empty() ? "" : ", ";
    low += separator + NumberText(dimension.low);
    high += separator + NumberText(dimension.high);
  }
  return fmt::format(
      R"({{"type": "Box", "dtype": "float32", "shape": [{}], "low": [{}], "high": [{}]}})",
      space.size(), low, high);
}

// The text of Gymnasium's EnvSpec of the environment as client/python/b4mrl/registration.py
// registers it.
std::string EnvironmentSpecText(const DatasetProvenance& provenance) {
  Json arguments = {{"environment", provenance.environment}};
  if (!provenance.simulator.empty()) arguments["simulator"] = provenance.simulator;
  return Dump({{"id", fmt::format("b4mrl/{}-v0", provenance.environment)},
               {"entry_point", "b4mrl.registration:make"},
               {"reward_threshold", nullptr},
               {"nondeterministic", false},
               {"max_episode_steps", nullptr},
               {"order_enforce", true},
               {"disable_env_checker", false},
               {"kwargs", arguments},
               {"additional_wrappers", Json::array()},
               {"vector_entry_point", "b4mrl.registration:make_vec"}});
}

Json OwnEntry(const MinariDescription& description) {
  const DatasetProvenance& provenance = description.metadata.provenance;
  Json own = Json::object();
  for (const TextEntry& entry : kExportedTexts) own[entry.name] = provenance.*entry.text;
  own["hidden_dimensions"] = provenance.hidden_dimensions;
  own["history_length"] = provenance.history_length;
  own["episodes"] = description.metadata.episodes;
  own["last_episode_unfinished"] = description.metadata.last_is_unfinished;
  for (const auto& [name, text] : description.source) own[name] = text;
  return own;
}

// `text` with Infinity, -Infinity and NaN outside of strings, which Python writes and JSON does not
// have, as null.
std::string WithoutInfinities(std::string_view text) {
  constexpr std::array<std::string_view, 3> kWords = {"-Infinity", "Infinity", "NaN"};
  std::string out;
  out.reserve(text.size());
  bool in_string = false;
  for (size_t i = 0; i < text.size();) {
    std::string_view taken = text.substr(i, 1), put = taken;
    if (in_string && text[i] == '\\') taken = put = text.substr(i, 2);
    if (text[i] == '"') in_string = !in_string;
    for (const std::string_view word : kWords) {
      if (in_string || !text.substr(i).starts_with(word)) continue;
      taken = word;
      put = "null";
      break;
    }
    out += put;
    i += taken.size();
  }
  return out;
}

Json Parse(std::string_view text) {
  constexpr int kMaxDepth = 64;  // nothing that is read here is nested as deep
  return ParseShallow<Json>(WithoutInfinities(text), kMaxDepth);
}

Status Refuse(std::string_view entry, const Json& value, std::string_view allowed) {
  constexpr size_t kShown = 80;  // bytes of the value in the message
  std::string shown = Dump(value);
  if (shown.size() > kShown) shown = shown.substr(0, kShown) + "...";
  return InvalidArgument(fmt::format("entry '{}' of {}", entry, kMinariMetadataFile), shown,
                         allowed);
}

Result<uint64_t> CountOf(const Json& json, const char* entry, uint64_t most) {
  const Json value = json.value(entry, Json());
  if (value.is_number_unsigned() && value >= 1u && value <= most) return value.get<uint64_t>();
  return Refuse(entry, value, fmt::format("1..{}", most));
}

// A text that the file may lack; "" if it is anything but a text of at most `most` bytes.
std::string TextOf(const Json& json, const char* entry, size_t most = kMaxProvenanceText) {
  const auto found = json.find(entry);
  if (found == json.end() || !found->is_string()) return "";
  std::string text = found->get<std::string>();
  return text.size() <= most ? text : "";
}

Result<uint32_t> BoxSizeOf(const Json& json, const char* entry, uint64_t most) {
  const Json text = json.value(entry, Json());
  const Json space = text.is_string() ? Parse(text.get_ref<const std::string&>()) : Json();
  if (!space.is_object()) return Refuse(entry, text, "the text of a space");
  const Json type = space.value("type", Json());
  const Json dtype = space.value("dtype", Json());
  const Json shape = space.value("shape", Json());
  const std::string allowed = fmt::format("a Box of float32 or float64 and shape [1..{}]", most);
  if (type != "Box") return Refuse(entry, type, allowed);
  if (dtype != "float32" && dtype != "float64") return Refuse(entry, dtype, allowed);
  if (!shape.is_array() || shape.size() != 1 || !shape[0].is_number_unsigned() || shape[0] < 1u ||
      shape[0] > most) {
    return Refuse(entry, shape, allowed);
  }
  return shape[0].get<uint32_t>();
}

// Reads what B4MRL itself wrote about the rows' origin.
Status ParseOwnEntry(const Json& json, MinariMetadata* metadata) {
  const auto own = json.find("b4mrl");
  if (own == json.end() || !own->is_object()) return Status();
  DatasetProvenance& provenance = metadata->provenance;
  for (const TextEntry& entry : kExportedTexts) provenance.*entry.text = TextOf(*own, entry.name);
  const Json hidden = own->value("hidden_dimensions", Json::array());
  const auto is_dimension = [](const Json& value) {
    return value.is_number_unsigned() && value < limits::kMaxObservationDimensions;
  };
  if (!hidden.is_array() || hidden.size() > limits::kMaxObservationDimensions ||
      !std::all_of(hidden.begin(), hidden.end(), is_dimension)) {
    return Refuse("b4mrl/hidden_dimensions", hidden, "numbers of observation dimensions");
  }
  provenance.hidden_dimensions = hidden.get<std::vector<uint32_t>>();
  if (own->contains("history_length")) {
    B4MRL_ASSIGN_OR_RETURN(const uint64_t length,
                           CountOf(*own, "history_length", kMaxAgentHistory));
    provenance.history_length = static_cast<uint32_t>(length);
  }
  metadata->d4rl_transitions = own->value("transitions", Json()) == "d4rl";
  // Minari keeps this entry when it appends episodes; the last one is then another one.
  const bool is_as_written = own->value("episodes", Json(metadata->episodes)) == metadata->episodes;
  metadata->last_is_unfinished =
      is_as_written && own->value("last_episode_unfinished", Json()) == true;
  return provenance.Validate();
}

void ParseEnvironment(const Json& json, MinariMetadata* metadata) {
  const auto text = json.find("env_spec");
  if (text == json.end() || !text->is_string()) return;
  const Json spec = Parse(text->get_ref<const std::string&>());
  if (!spec.is_object()) return;
  metadata->gymnasium_id = TextOf(spec, "id", kMaxIdBytes);
  const auto arguments = spec.find("kwargs");
  if (arguments == spec.end() || arguments->empty()) return;
  metadata->gymnasium_kwargs = arguments->dump(-1, ' ', /*ensure_ascii=*/true);
}

}  // namespace

std::string MinariMetadataText(const MinariDescription& description, uint64_t data_bytes) {
  const MinariMetadata& metadata = description.metadata;
  Json json = {{"dataset_id", metadata.id},
               {"total_episodes", metadata.episodes},
               {"total_steps", metadata.rows},
               {"data_format", "hdf5"},
               {"observation_space", BoxText(description.observation)},
               {"action_space", BoxText(description.action)},
               {"minari_version", kMinariVersion},
               {"dataset_size", std::round(static_cast<double>(data_bytes) / 1e5) / 10},
               {"description", metadata.description}};
  if (!metadata.algorithm.empty()) json["algorithm_name"] = metadata.algorithm;
  if (!description.author.empty()) json["author"] = {description.author};
  if (!metadata.provenance.environment.empty()) {
    json["env_spec"] = EnvironmentSpecText(metadata.provenance);
  }
  if (description.reference_min && description.reference_max) {
    json["ref_min_score"] = *description.reference_min;
    json["ref_max_score"] = *description.reference_max;
  }
  json["b4mrl"] = OwnEntry(description);
  return Dump(json, 2) + "\n";
}

Result<ParsedMinariMetadata> ParseMinariMetadata(std::string_view text) {
  const Json json = Parse(text);
  if (!json.is_object()) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("{} holds no JSON object", kMinariMetadataFile));
  }
  const Json format = json.value("data_format", Json());
  if (format != "hdf5") return Refuse("data_format", format, "hdf5");
  ParsedMinariMetadata parsed;
  MinariMetadata& metadata = parsed.metadata;
  B4MRL_ASSIGN_OR_RETURN(metadata.episodes, CountOf(json, "total_episodes", kMaxMinariEpisodes));
  B4MRL_ASSIGN_OR_RETURN(metadata.rows, CountOf(json, "total_steps", limits::kMaxDatasetRows));
  B4MRL_ASSIGN_OR_RETURN(parsed.observation_size,
                         BoxSizeOf(json, "observation_space", limits::kMaxObservationDimensions));
  B4MRL_ASSIGN_OR_RETURN(parsed.action_size,
                         BoxSizeOf(json, "action_space", limits::kMaxActionDimensions));
  metadata.id = TextOf(json, "dataset_id", kMaxIdBytes);
  metadata.algorithm = TextOf(json, "algorithm_name");
  ParseEnvironment(json, &metadata);
  B4MRL_RETURN_IF_ERROR(ParseOwnEntry(json, &metadata));
  return parsed;
}

}  // namespace b4mrl

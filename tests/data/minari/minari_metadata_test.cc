#include "data/minari/minari_metadata.h"

#include <catch2/catch.hpp>
#include <limits>
#include <nlohmann/json.hpp>

namespace b4mrl {
namespace {

using nlohmann::json;

SpaceSpec Box(size_t size, double bound) {
  SpaceSpec space;
  space.dimensions.resize(size, {.low = -bound, .high = bound});
  return space;
}

MinariDescription Example() {
  MinariDescription description;
  description.metadata.id = "b4mrl/HalfCheetah/x-v0";
  description.metadata.episodes = 3;
  description.metadata.rows = 70;
  description.metadata.algorithm = "sac";
  description.metadata.provenance.environment = "HalfCheetah";
  description.metadata.provenance.simulator = "hidden=9+16";
  description.metadata.provenance.hidden_dimensions = {9, 16};
  description.metadata.provenance.history_length = 3;
  description.metadata.provenance.license = "CC-BY-4.0";
  description.metadata.last_is_unfinished = true;
  description.observation = Box(17, std::numeric_limits<double>::infinity());
  description.action = Box(6, 1);
  description.reference_min = -280.178953;
  description.reference_max = 12135;
  return description;
}

// The example's metadata with the entry `name` replaced, or removed if `value` is null.
std::string With(const char* name, const json& value) {
  json metadata = json::parse(MinariMetadataText(Example(), 0));
  metadata[name] = value;
  if (value.is_null()) metadata.erase(name);
  return metadata.dump();
}

std::string BoxText(const json& shape, const char* type = "Box", const char* dtype = "float64") {
  return json{{"type", type}, {"dtype", dtype}, {"shape", shape}}.dump();
}

TEST_CASE("written metadata read back equal") {
  const auto parsed = ParseMinariMetadata(MinariMetadataText(Example(), 1'234'567));
  REQUIRE(parsed.ok());
  CHECK(parsed->observation_size == 17);
  CHECK(parsed->action_size == 6);
  CHECK(parsed->metadata.id == "b4mrl/HalfCheetah/x-v0");
  CHECK(parsed->metadata.episodes == 3);
  CHECK(parsed->metadata.rows == 70);
  CHECK(parsed->metadata.algorithm == "sac");
  CHECK(parsed->metadata.gymnasium_id == "b4mrl/HalfCheetah-v0");
  CHECK(parsed->metadata.last_is_unfinished);
  CHECK(parsed->metadata.provenance == Example().metadata.provenance);
}

TEST_CASE("spaces are written as Minari writes them, with Python's infinities") {
  const json metadata = json::parse(MinariMetadataText(Example(), 1'234'567));
  CHECK(metadata["dataset_size"] == 1.2);
  CHECK(metadata["action_space"] ==
        R"({"type": "Box", "dtype": "float32", "shape": [6], )"
        R"("low": [-1.0, -1.0, -1.0, -1.0, -1.0, -1.0], "high": [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]})");
  CHECK_THAT(metadata["observation_space"].get<std::string>(),
             Catch::Contains("\"low\": [-Infinity, -Infinity,") &&
                 Catch::Contains("\"high\": [Infinity, Infinity,"));
  const json spec = json::parse(metadata["env_spec"].get<std::string>());
  CHECK(spec["kwargs"] == json{{"environment", "HalfCheetah"}, {"simulator", "hidden=9+16"}});
}

TEST_CASE("metadata of others give the environment's id and arguments, and no provenance") {
  json metadata = json::parse(With("b4mrl", nullptr));
  metadata["env_spec"] = R"({"id": "HalfCheetah-v5", "kwargs": {"reset_noise_scale": 0.2}})";
  // Python's json module writes numbers that are not finite as words.
  std::string text = metadata.dump();
  text.insert(text.size() - 1, R"(, "ref_max_score": NaN, "note": "\"-Infinity NaN\\")");
  const auto parsed = ParseMinariMetadata(text);
  REQUIRE(parsed.ok());
  CHECK(parsed->metadata.gymnasium_id == "HalfCheetah-v5");
  CHECK(parsed->metadata.gymnasium_kwargs == R"({"reset_noise_scale":0.2})");
  CHECK(parsed->metadata.provenance == DatasetProvenance());
}

TEST_CASE("every entry outside its range is refused by its name") {
  struct Case {
    const char* entry;
    json value;
  };
  const std::vector<Case> cases = {
      {"data_format", "arrow"},
      {"data_format", nullptr},
      {"total_episodes", 0},
      {"total_episodes", -1},
      {"total_episodes", 1e18},
      {"total_episodes", 1'000'001},
      {"total_episodes", "3"},
      {"total_steps", nullptr},
      {"total_steps", 100'000'001},
      {"observation_space", nullptr},
      {"observation_space", 7},
      {"observation_space", "{"},
      {"observation_space", "[]"},
      {"observation_space", BoxText({17}, "Dict")},
      {"observation_space", BoxText({84, 84, 3})},
      {"observation_space", BoxText({0})},
      {"observation_space", BoxText({4097})},
      {"observation_space", BoxText({17}, "Box", "uint8")},
      {"action_space", R"({"type": "Discrete", "n": 4})"},
      {"action_space", BoxText({1025})},
      {"action_space", BoxText(json::array())},
  };
  for (const Case& c : cases) {
    INFO(c.entry << " " << c.value);
    const auto parsed = ParseMinariMetadata(With(c.entry, c.value));
    CHECK(parsed.status().code() == StatusCode::kInvalidArgument);
    CHECK_THAT(parsed.status().message(), Catch::Contains(c.entry));
  }
}

TEST_CASE("the last episode is unfinished only while it is the one that was written last") {
  json own = json::parse(MinariMetadataText(Example(), 0))["b4mrl"];
  const auto is_unfinished = [](const json& entry) {
    return ParseMinariMetadata(With("b4mrl", entry))->metadata.last_is_unfinished;
  };
  CHECK(is_unfinished(own));
  own["episodes"] = 2;  // Minari has appended one
  CHECK_FALSE(is_unfinished(own));
  own.erase("episodes");  // as 0.1.0 wrote it
  CHECK(is_unfinished(own));
}

TEST_CASE("entries that are nested a million times are refused") {
  const std::string nested = std::string(1'000'000, '[') + std::string(1'000'000, ']');
  std::string text = With("data_format", "NESTED");
  text.replace(text.find("\"NESTED\""), 8, nested);
  CHECK_FALSE(ParseMinariMetadata(text).ok());
}

TEST_CASE("hostile provenance is refused or ignored") {
  const auto code = [](const json& own) {
    return ParseMinariMetadata(With("b4mrl", own)).status().code();
  };
  CHECK(code({{"hidden_dimensions", {9, 3}}}) == StatusCode::kInvalidArgument);
  CHECK(code({{"hidden_dimensions", {-1}}}) == StatusCode::kInvalidArgument);
  CHECK(code({{"hidden_dimensions", "9"}}) == StatusCode::kInvalidArgument);
  CHECK(code({{"history_length", 0}}) == StatusCode::kInvalidArgument);
  CHECK(code({{"recipe", std::string(100'000, 'x')}}) == StatusCode::kOk);
  CHECK(code({{"last_episode_unfinished", "yes"}, {"environment", 3}}) == StatusCode::kOk);
  CHECK(code("text") == StatusCode::kOk);
}

TEST_CASE("text that is no JSON object is refused") {
  for (const std::string& text :
       {std::string(), std::string("[1]"), std::string("{\"a\": "), std::string("{\"a\": \"\\"),
        std::string(1 << 20, '['), std::string("\"\xff\"")}) {
    CHECK(ParseMinariMetadata(text).status().code() == StatusCode::kDataLoss);
  }
}

}  // namespace
}  // namespace b4mrl

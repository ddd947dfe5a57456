#include "server/datasets/provenance_json.h"

#include <catch2/catch.hpp>
#include <cstdint>
#include <nlohmann/json.hpp>

namespace b4mrl {
namespace {

using Json = nlohmann::json;

DatasetProvenance Example() {
  DatasetProvenance provenance;
  provenance.environment = "HalfCheetah";
  provenance.hidden_dimensions = {9, 16};
  provenance.history_length = 2;
  provenance.parts = {{"SAC", "ab", UINT64_MAX, 50}};
  return provenance;
}

TEST_CASE("a provenance comes back from JSON as it was, with seeds of 64 bits") {
  const auto back = ProvenanceOf(ToJson(Example()));
  REQUIRE(back.ok());
  CHECK(*back == Example());
}

TEST_CASE("numbers of a provenance that 32 bits cannot hold are refused, not cut") {
  // Cut to 32 bits, each of them would be a number that is allowed.
  Json history = ToJson(Example());
  history["history_length"] = (uint64_t{1} << 32) + 2;
  CHECK(ProvenanceOf(history).status().code() == StatusCode::kDataLoss);
  Json hidden = ToJson(Example());
  hidden["hidden_dimensions"][1] = (uint64_t{1} << 32) + 16;
  CHECK(ProvenanceOf(hidden).status().code() == StatusCode::kDataLoss);
}

}  // namespace
}  // namespace b4mrl

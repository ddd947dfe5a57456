#include "proto/wire/json_depth.h"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <string>

namespace b4mrl {
namespace {

using Json = nlohmann::json;

TEST_CASE("lists and objects inside each other are counted, but not those beside each other") {
  CHECK_FALSE(NestsDeeper("", 0));
  CHECK_FALSE(NestsDeeper("1.5", 0));
  CHECK(NestsDeeper("[]", 0));
  CHECK_FALSE(NestsDeeper("[]", 1));
  CHECK(NestsDeeper(R"({"a": [1]})", 1));
  CHECK_FALSE(NestsDeeper(R"({"a": [1], "b": [2], "c": {}})", 2));
  CHECK(NestsDeeper(R"([[1], {"a": [2]}])", 2));
}

TEST_CASE("brackets within texts count for nothing, also behind escaped quotation marks") {
  CHECK_FALSE(NestsDeeper(R"(["[[[[", "{{{{"])", 1));
  CHECK_FALSE(NestsDeeper(R"(["\"[[[["])", 1));
  CHECK(NestsDeeper(R"(["\\", [[1]]])", 2));
  CHECK_FALSE(NestsDeeper(R"(["\)", 1));  // the text ends behind the escape
}

TEST_CASE("entries of one object are counted, but not those of others or within texts") {
  CHECK_FALSE(HasLargerObject("", 0));
  CHECK_FALSE(HasLargerObject("[1, {}]", 0));
  CHECK(HasLargerObject(R"({"a": 1})", 0));
  CHECK_FALSE(HasLargerObject(R"({"a": {"b": 1}, "c": [{"d": 1}, {"e": 1}]})", 2));
  CHECK(HasLargerObject(R"({"a": {"b": 1, "c": 2}, "d": 3})", 1));
  CHECK(HasLargerObject(R"({"a": {"b": 1}, "c": 2, "d": 3})", 2));
  CHECK_FALSE(HasLargerObject(R"({"a:\"::": ":::"})", 1));
  CHECK_FALSE(HasLargerObject("]]]]{[[{", 0));
  CHECK(HasLargerObject("}}:", 0));
}

TEST_CASE("JSON is parsed up to the allowed depth, and discarded beyond it") {
  CHECK(ParseShallow<Json>(R"({"a": [1, {"b": 2}]})", 3)["a"][1]["b"] == 2);
  CHECK(ParseShallow<Json>(R"({"a": [1, {"b": 2}]})", 2).is_discarded());
  CHECK(ParseShallow<Json>(R"({"a": )", 3).is_discarded());
  const size_t deep = 1'000'000;
  CHECK(ParseShallow<Json>(std::string(deep, '[') + std::string(deep, ']'), 8).is_discarded());
}

}  // namespace
}  // namespace b4mrl

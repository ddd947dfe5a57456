#include "proto/base/spec.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("Lists of perturbations are split at commas and the first equals sign") {
  const auto items = ParseNamedArguments("gravity=1.5,obs-noise-low,hidden=v-root-z=9");
  REQUIRE(items.ok());
  REQUIRE(*items == std::vector<NamedArgument>{
                        {"gravity", "1.5"}, {"obs-noise-low", ""}, {"hidden", "v-root-z=9"}});
  REQUIRE(FormatNamedArguments(*items) == "gravity=1.5,obs-noise-low,hidden=v-root-z=9");
  REQUIRE(ParseNamedArguments("")->empty());
  REQUIRE(FormatNamedArguments({}) == "");
}

TEST_CASE("Malformed lists are refused with the item that is wrong") {
  for (const char* text : {",", "gravity,", ",gravity", "gravity,,friction", "=2",
                           "gravity=", "Gravity=2", "gra vity", "gravity;2", "gravity\xff"}) {
    CAPTURE(text);
    REQUIRE(ParseNamedArguments(text).status().code() == StatusCode::kInvalidArgument);
  }
  REQUIRE(ParseNamedArguments("gravity=2,Bad=1").status().message().find("Bad=1") !=
          std::string::npos);
}

TEST_CASE("Numbers use the whole text, are finite and in range") {
  REQUIRE(*ParseFinite("x", "1.5", 0, 2) == 1.5);
  REQUIRE(*ParseFinite("x", "-1e-3", -1, 2) == -1e-3);
  for (const char* text :
       {"", " 1", "1 ", "1x", "nan", "inf", "-inf", "1e999", "0x10", "2.1", "+1", "1,5"}) {
    CAPTURE(text);
    const Status status = ParseFinite("factor", text, 0, 2).status();
    REQUIRE(status.code() == StatusCode::kInvalidArgument);
    REQUIRE(status.message().find("0..2") != std::string::npos);
  }
}

TEST_CASE("Whole numbers use the whole text and do not wrap round") {
  REQUIRE(*ParseUnsigned("n", "18446744073709551615", 0, UINT64_MAX) == UINT64_MAX);
  for (const char* text : {"", "-1", "1.0", "18446744073709551616", "0", "11", "1e1", " 5"}) {
    CAPTURE(text);
    REQUIRE(ParseUnsigned("n", text, 1, 10).status().code() == StatusCode::kInvalidArgument);
  }
}

TEST_CASE("Dimensions are found by name and by index, and nothing else") {
  SpaceSpec space;
  space.dimensions = {{"z-root", "m", -1, 1}, {"v-root-z", "m/s", -1, 1}, {"0", "", 0, 1}};
  REQUIRE(*space.FindDimension("v-root-z") == 1);
  REQUIRE(*space.FindDimension("1") == 1);
  REQUIRE(*space.FindDimension("0") == 2);  // a name goes before an index
  REQUIRE(space.FindDimension("3").status().code() == StatusCode::kInvalidArgument);
  const Status typo = space.FindDimension("v-root-x").status();
  REQUIRE(typo.code() == StatusCode::kUnknownName);
  REQUIRE(typo.message().find("did you mean 'v-root-z'?") != std::string::npos);
  REQUIRE_FALSE(space.FindDimension("").ok());
  REQUIRE_FALSE(space.FindDimension("-1").ok());
}

TEST_CASE("Scores are normalised between the reference returns, where there are any") {
  EnvironmentSpec spec;
  REQUIRE_FALSE(spec.NormalisedScore(10).has_value());
  spec.reference_min = -280.178953;
  spec.reference_max = 12135.0;
  REQUIRE(*spec.NormalisedScore(-280.178953) == 0);
  REQUIRE(*spec.NormalisedScore(12135.0) == 100);
}

}  // namespace
}  // namespace b4mrl

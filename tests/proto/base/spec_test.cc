#include "proto/base/spec.h"

#include <catch2/catch.hpp>
#include <limits>
#include <string>
#include <utility>

#include "proto/base/rng.h"

namespace b4mrl {
namespace {

TEST_CASE("a list of perturbations parses and formats back") {
  for (const char* text : {"", "gravity", "gravity=1.5", "gravity=2,obs-noise-low,hidden=9+10",
                           "hidden=v-root-z", "model=FILE_2.xml"}) {
    const auto items = ParseNamedArguments(text);
    REQUIRE(items.ok());
    CHECK(FormatNamedArguments(*items) == text);
  }
  const auto items = ParseNamedArguments("gravity=1.5,cars");
  REQUIRE(items->size() == 2);
  CHECK((*items)[0] == NamedArgument{"gravity", "1.5"});
  CHECK((*items)[1] == NamedArgument{"cars", ""});
}

TEST_CASE("malformed lists are refused with the offending item") {
  for (const char* text : {",", "gravity,", ",gravity", "a,,b", "Gravity", "gravity=1, ", "=2", " ",
                           "gravity=", "gravity= ", "gra vity", "gra\xff", "a=1,b!"}) {
    INFO(text);
    CHECK(ParseNamedArguments(text).status().code() == StatusCode::kInvalidArgument);
  }
  CHECK(ParseNamedArguments("gravity,B!").status().message().find("'B!'") != std::string::npos);
}

TEST_CASE("spaces around names and arguments do not count") {
  const auto items = ParseNamedArguments(" gravity = 2 , obs-noise-low,hidden= 9+10 ");
  REQUIRE(items.ok());
  CHECK(FormatNamedArguments(*items) == "gravity=2,obs-noise-low,hidden=9+10");
}

TEST_CASE("what parses, formats to a list that parses to the same") {
  Rng rng(1, "spec-fuzz");
  constexpr std::string_view kAlphabet = "ab-,,==.19";
  int accepted = 0;
  for (int i = 0; i < 20'000; ++i) {
    std::string text(rng.Below(12), ' ');
    for (char& c : text) c = kAlphabet[rng.Below(kAlphabet.size())];
    const auto items = ParseNamedArguments(text);
    if (!items.ok()) continue;
    ++accepted;
    REQUIRE(ParseNamedArguments(FormatNamedArguments(*items)).ok());
    REQUIRE(*ParseNamedArguments(FormatNamedArguments(*items)) == *items);
  }
  CHECK(accepted > 1000);
}

TEST_CASE("a dimension is found by name or index") {
  SpaceSpec space;
  space.dimensions = {{"z", "m", -1, 1}, {"v-root-z", "m/s", -1, 1}};
  CHECK(*space.FindDimension("v-root-z") == 1);
  CHECK(*space.FindDimension("0") == 0);
  CHECK(space.FindDimension("2").status().code() == StatusCode::kInvalidArgument);
  CHECK(space.FindDimension("-1").status().code() == StatusCode::kUnknownName);
  CHECK(space.FindDimension("").status().code() == StatusCode::kUnknownName);
  CHECK(space.FindDimension("v-root-y").status().message().find("v-root-z") != std::string::npos);
  space.dimensions.push_back({"0", "", -1, 1});
  CHECK(*space.FindDimension("0") == 2);  // a name goes before an index
  CHECK(SpaceSpec().FindDimension("0").status().code() == StatusCode::kUnknownName);
}

TEST_CASE("a feature names its dimension in every row, before any index") {
  SpaceSpec space;
  for (const char* row : {"ego", "car1", "car2"}) {
    for (const char* feature : {"x", "vx"}) {
      space.dimensions.push_back({std::string(row) + "-" + feature, "", -1, 1, feature});
    }
  }
  CHECK(*space.FindDimensions("vx") == std::vector<uint32_t>{1, 3, 5});
  CHECK(*space.FindDimensions("car1-vx") == std::vector<uint32_t>{3});
  CHECK(*space.FindDimensions("4") == std::vector<uint32_t>{4});
  for (const char* unknown : {"", "vy", "6"}) CHECK_FALSE(space.FindDimensions(unknown).ok());
  const std::string message = space.FindDimensions("vxx").status().message();
  CHECK(message.find("did you mean 'vx'") != std::string::npos);
}

TEST_CASE("a list of dimensions mixes indices, names and features, and has no empty item") {
  SpaceSpec space;
  for (const char* row : {"ego", "car"}) {
    for (const char* feature : {"x", "vx"}) {
      space.dimensions.push_back({std::string(row) + "-" + feature, "", -1, 1, feature});
    }
  }
  CHECK(*space.ParseDimensions("2") == std::vector<uint32_t>{2});
  CHECK(*space.ParseDimensions("vx+0+car-vx+0") == std::vector<uint32_t>{0, 1, 3});
  for (const char* refused : {"", "+", "0+", "+0", "0++1", "0+4", "0,1", "0 + 1"}) {
    CAPTURE(refused);
    CHECK_FALSE(space.ParseDimensions(refused).ok());
  }
}

TEST_CASE("learners scale actions by one number a dimension, or refuse the environment") {
  EnvironmentSpec spec;
  spec.action.dimensions = {{"hinge", "N m", -1, 1}, {"slide", "N", -0.4, 0.4}};
  CHECK(spec.CheckActionScale().ok());
  CHECK(spec.ActionScale() == std::vector<float>{1.0f, 0.4f});
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const auto& [low, high] : {std::pair{0.0, 1.0}, std::pair{-2.0, 1.0}, std::pair{0.0, 0.0},
                                  std::pair{-kInfinity, kInfinity}, std::pair{1.0, -1.0}}) {
    spec.action.dimensions[1].low = low;
    spec.action.dimensions[1].high = high;
    const Status refused = spec.CheckActionScale();
    CHECK(refused.code() == StatusCode::kUnsupported);
    CHECK(refused.message().find("action 'slide'") != std::string::npos);
  }
}

TEST_CASE("normalised scores map the reference returns to 0 and 100") {
  EnvironmentSpec spec;
  CHECK_FALSE(spec.NormalisedScore(1).has_value());
  spec.reference_min = -280.178953;
  spec.reference_max = 12135.0;
  CHECK(*spec.NormalisedScore(-280.178953) == 0);
  CHECK(*spec.NormalisedScore(12135.0) == 100);
}

TEST_CASE("numbers are whole texts within their range") {
  CHECK(*ParseFinite("x", "1.5", 0, 2) == 1.5);
  CHECK(*ParseFinite("x", "-1e-3", -1, 2) == -1e-3);
  for (const char* text : {"", " 1", "1 ", "1x", "nan", "inf", "-inf", "1e400", "0x1p3", "1,5"}) {
    INFO(text);
    CHECK_FALSE(ParseFinite("x", text, -1e308, 1e308).ok());
  }
  CHECK(ParseFinite("factor", "3", 0, 2).status().message() ==
        "factor is '3', allowed: a number in 0..2");
  CHECK(*ParseUnsigned("n", "18446744073709551615", 0, UINT64_MAX) == UINT64_MAX);
  for (const char* text : {"", "-1", "+1", "1.0", "18446744073709551616", " 1", "0x10"}) {
    INFO(text);
    CHECK_FALSE(ParseUnsigned("n", text, 0, UINT64_MAX).ok());
  }
  CHECK_FALSE(ParseUnsigned("n", "0", 1, 5).ok());
  CHECK_FALSE(ParseUnsigned("n", "6", 1, 5).ok());
}

}  // namespace
}  // namespace b4mrl

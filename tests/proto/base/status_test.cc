#include "proto/base/status.h"

#include <catch2/catch.hpp>
#include <cerrno>
#include <memory>
#include <set>
#include <vector>

namespace b4mrl {
namespace {

Result<int> Half(int x) {
  if (x % 2 != 0) return InvalidNumber("x", x, "even numbers");
  return x / 2;
}

Result<int> Quarter(int x) {
  B4MRL_ASSIGN_OR_RETURN(const int half, Half(x));
  B4MRL_RETURN_IF_ERROR(Half(half).status());
  return Half(half);
}

TEST_CASE("Every code has a name of its own, and strangers are unknown") {
  std::set<std::string_view> names;
  for (int32_t code = 0; code <= 15; ++code) {
    names.insert(StatusCodeName(static_cast<StatusCode>(code)));
  }
  REQUIRE(names.size() == 16);
  REQUIRE(names.count("UNKNOWN") == 0);
  REQUIRE(StatusCodeName(static_cast<StatusCode>(16)) == "UNKNOWN");
  REQUIRE(StatusCodeName(static_cast<StatusCode>(-1)) == "UNKNOWN");
}

TEST_CASE("Errors name the thing, its value and what is allowed") {
  REQUIRE(InvalidNumber("num_envs", 0, "1..1024").ToString() ==
          "INVALID_ARGUMENT: num_envs is 0, allowed: 1..1024");
  REQUIRE(InvalidArgument("mode", "fast", "slow").message() == "mode is 'fast', allowed: slow");
  REQUIRE(IoError("read", "/x", ENOENT).message() == "cannot read /x: No such file or directory");
  REQUIRE(InvalidArgument("mode", std::string(100'000, 'x'), "slow").message().size() < 200);
  REQUIRE(Status().ToString() == "OK");
}

TEST_CASE("Context goes in front of the message and leaves OK alone") {
  const Status status = InvalidNumber("x", 1, "2").WithContext("lane 3");
  REQUIRE(status.message() == "lane 3: x is 1, allowed: 2");
  REQUIRE(status.code() == StatusCode::kInvalidArgument);
  REQUIRE(Status().WithContext("lane 3").ok());
}

TEST_CASE("Only what may pass by itself is recoverable") {
  for (const StatusCode code : {StatusCode::kBusy, StatusCode::kDeadlineExceeded,
                                StatusCode::kUnavailable, StatusCode::kLimitExceeded}) {
    REQUIRE(Status(code, "").recoverable());
  }
  for (const StatusCode code : {StatusCode::kInvalidArgument, StatusCode::kStale, StatusCode::kGap,
                                StatusCode::kSessionLost, StatusCode::kInternal}) {
    REQUIRE_FALSE(Status(code, "").recoverable());
  }
}

TEST_CASE("An unknown name is answered with the nearest known one") {
  const std::vector<std::string> known = {"HalfCheetah", "Hopper", "Walker2d"};
  const Status typo = UnknownName("environment", "HalfCheeta", known);
  REQUIRE(typo.code() == StatusCode::kUnknownName);
  REQUIRE(typo.message() ==
          "unknown environment 'HalfCheeta'; did you mean 'HalfCheetah'? known: HalfCheetah, "
          "Hopper, Walker2d");
  const Status strange = UnknownName("environment", "Pong", known);
  REQUIRE(strange.message().find("did you mean") == std::string::npos);
  REQUIRE(UnknownName("dataset", "x", std::vector<std::string>()).message() ==
          "unknown dataset 'x' known: none");
}

TEST_CASE("A name of a megabyte costs no quadratic search") {
  NearestName nearest(std::string(1 << 20, 'x'));
  nearest.Consider(std::string(1 << 20, 'y'));
  nearest.Consider("x");
  REQUIRE_FALSE(nearest.nearest().has_value());
}

TEST_CASE("Results carry values, move-only ones too, or the status through the macros") {
  REQUIRE(*Quarter(8) == 2);
  REQUIRE(Quarter(7).status().message() == "x is 7, allowed: even numbers");
  REQUIRE(Quarter(6).status().message() == "x is 3, allowed: even numbers");
  Result<std::unique_ptr<int>> pointer = std::make_unique<int>(5);
  REQUIRE(*std::move(pointer).value() == 5);
}

}  // namespace
}  // namespace b4mrl

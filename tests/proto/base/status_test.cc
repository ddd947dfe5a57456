#include "proto/base/status.h"

#include <catch2/catch.hpp>
#include <cerrno>
#include <memory>
#include <string>
#include <vector>

namespace b4mrl {
namespace {

TEST_CASE("the codes' numbers are those of the wire") {
  CHECK(static_cast<int>(StatusCode::kInvalidArgument) == 1);
  CHECK(static_cast<int>(StatusCode::kBusy) == 4);
  CHECK(static_cast<int>(StatusCode::kGap) == 6);
  CHECK(static_cast<int>(StatusCode::kSessionLost) == 11);
  CHECK(static_cast<int>(StatusCode::kInternal) == 15);
  for (int code = 0; code <= 15; ++code) {
    CHECK(StatusCodeName(static_cast<StatusCode>(code)) != "UNKNOWN");
  }
  CHECK(StatusCodeName(static_cast<StatusCode>(16)) == "UNKNOWN");
  CHECK(StatusCodeName(static_cast<StatusCode>(-1)) == "UNKNOWN");
}

TEST_CASE("a status says what is wrong in one line") {
  CHECK(Status().ToString() == "OK");
  const Status status = InvalidArgument("num_envs", "0", "1..1024");
  CHECK(status.ToString() == "INVALID_ARGUMENT: num_envs is '0', allowed: 1..1024");
  CHECK(status.WithContext("Open").message() == "Open: num_envs is '0', allowed: 1..1024");
  CHECK(InvalidNumber("rate", -1.5, "0..1").message() == "rate is -1.5, allowed: 0..1");
  CHECK(IoError("read", "/x", ENOENT).ToString() ==
        "IO_ERROR: cannot read /x: No such file or directory");
}

TEST_CASE("a long value from a peer is cut") {
  CHECK(InvalidArgument("name", std::string(5000, 'a'), "short").message().size() < 200);
}

TEST_CASE("an unknown name is answered with the nearest known one and all of them") {
  const std::vector<std::string> known = {"HalfCheetah", "Hopper", "Walker2d"};
  const std::string message = UnknownName("environment", "halfcheetah", known).message();
  CHECK(message.find("'halfcheetah'") != std::string::npos);
  CHECK(message.find("did you mean 'HalfCheetah'?") != std::string::npos);
  CHECK(message.find("HalfCheetah, Hopper, Walker2d") != std::string::npos);
  CHECK(UnknownName("environment", "xyzzy", known).message().find("did you mean") ==
        std::string::npos);
  CHECK(UnknownName("environment", "", std::vector<std::string>()).message().find("none") !=
        std::string::npos);
}

TEST_CASE("a name in a folder is compared with the others there by what follows the folder") {
  const auto nearest = [](const char* name, const std::vector<std::string>& known) {
    NearestName search(name);
    for (const std::string& each : known) search.Consider(each);
    return search.nearest().value_or("");
  };
  const std::vector<std::string> known = {"HalfCheetah/hid", "HalfCheetah/medium-v0",
                                          "HalfCheetah/mr", "Hopper/medium-replay-v0"};
  CHECK(nearest("HalfCheetah/medum", known) == "HalfCheetah/medium-v0");
  CHECK(nearest("HalfCheetah/medum-v0", known) == "HalfCheetah/medium-v0");
  CHECK(nearest("HalfCheetah/medium-v1", known) == "HalfCheetah/medium-v0");
  CHECK(nearest("HalfCheetha/medium", known) == "HalfCheetah/medium-v0");
  CHECK(nearest("Hopper/medium-reply", known) == "Hopper/medium-replay-v0");
  for (const char* name : {"HalfCheetah/expert", "HalfCheetah/", "HalfCheetah/x", "Hopper/mr"}) {
    CAPTURE(name);
    CHECK(nearest(name, known).empty());
  }
}

TEST_CASE("a name of a megabyte costs no quadratic search") {
  NearestName nearest(std::string(1 << 20, 'x'));
  nearest.Consider(std::string(1 << 20, 'y'));
  nearest.Consider("x");
  REQUIRE_FALSE(nearest.nearest().has_value());
}

TEST_CASE("what may succeed later is recoverable") {
  CHECK(Status(StatusCode::kBusy, "").recoverable());
  CHECK(Status(StatusCode::kUnavailable, "").recoverable());
  CHECK_FALSE(Status(StatusCode::kInvalidArgument, "").recoverable());
  CHECK_FALSE(Status(StatusCode::kGap, "").recoverable());
}

TEST_CASE("an error of the system is told by its number, whatever stands before its message") {
  const Status full = IoError("write", "cache", EDQUOT);
  CHECK(IsIoErrorOf(full, EDQUOT));
  CHECK(IsIoErrorOf(Status(full.code(), full.message()).WithContext("a file"), EDQUOT));
  CHECK_FALSE(IsIoErrorOf(IoError("write", "cache", ENOSPC), EDQUOT));
  CHECK_FALSE(IsIoErrorOf(Status(StatusCode::kDataLoss, full.message()), EDQUOT));
  CHECK_FALSE(IsIoErrorOf(Status(), EDQUOT));
}

Result<int> Half(int x) {
  if (x % 2 != 0) return InvalidNumber("x", x, "even numbers");
  return x / 2;
}
Result<int> Quarter(int x) {
  B4MRL_ASSIGN_OR_RETURN(const int half, Half(x));
  B4MRL_RETURN_IF_ERROR(Half(half).status());
  return Half(half);
}

TEST_CASE("errors pass through the macros and values come out") {
  CHECK(*Quarter(12) == 3);
  CHECK(Quarter(7).status().message() == "x is 7, allowed: even numbers");
  CHECK(Quarter(6).status().message() == "x is 3, allowed: even numbers");
  Result<std::unique_ptr<int>> move_only = std::make_unique<int>(5);
  CHECK(*std::move(move_only).value() == 5);
}

}  // namespace
}  // namespace b4mrl

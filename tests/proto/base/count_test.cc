#include "proto/base/count.h"

#include <catch2/catch.hpp>
#include <limits>
#include <string>
#include <utility>

namespace b4mrl {
namespace {

constexpr uint64_t kMost = std::numeric_limits<uint64_t>::max();

TEST_CASE("A count may be written with a decimal point and an exponent, as long as it is whole") {
  const std::pair<const char*, uint64_t> kWritten[] = {{"0", 0},
                                                       {"007", 7},
                                                       {"250000", 250'000},
                                                       {"1e6", 1'000'000},
                                                       {"1E+6", 1'000'000},
                                                       {"2.5e5", 250'000},
                                                       {"12.50e1", 125},
                                                       {"3.0", 3},
                                                       {"3.", 3},
                                                       {".5e1", 5},
                                                       {"0e999999", 0},
                                                       {"18446744073709551615", kMost},
                                                       {"18446744073709551.615e3", kMost}};
  for (const auto& [text, value] : kWritten) {
    INFO(text);
    const Result<uint64_t> count = ParseCount(text, 0, kMost);
    REQUIRE(count.ok());
    CHECK(*count == value);
  }
}

TEST_CASE("What is not a whole number is no count") {
  for (const std::string text : {"",
                                 "-1",
                                 "+1",
                                 "-0",
                                 "1.5",
                                 "1e-6",
                                 "15e-1",
                                 "1e",
                                 "1e+",
                                 "e6",
                                 ".",
                                 "1e6x",
                                 "0x10",
                                 "1 000",
                                 " 1",
                                 "nan",
                                 "inf",
                                 "1e20",
                                 "1e99999999999999999999",
                                 "18446744073709551616"}) {
    INFO(text);
    CHECK(ParseCount(text, 0, kMost).status().code() == StatusCode::kInvalidArgument);
  }
}

TEST_CASE("A count outside its range is refused with value and range") {
  CHECK(ParseCount("100", 1, 100).ok());
  for (const char* text : {"0", "101", "1e3", "-5"}) {
    const Status status = ParseCount(text, 1, 100).status();
    CHECK(status.message() == std::string(text) + " is not a whole number in 1..100");
  }
  CHECK(ParseCount(std::string(10'000, '9'), 1, 100).status().message().size() < 200);
}

TEST_CASE("An option's text becomes plain digits, or says what is wrong with it") {
  std::string text = "1e3";
  CHECK(CountText(1, 5000)(text).empty());
  CHECK(text == "1000");
  text = "-1";
  CHECK(CountText(1, 5000)(text) == "-1 is not a whole number in 1..5000");
}

}  // namespace
}  // namespace b4mrl

// JSON that others have written is refused where there is no memory for it.
#include "benchmarks/records/json_file.h"

#include <sys/resource.h>

#include <catch2/catch.hpp>
#include <string>

#include "tests/resource_limit.h"
#include "tests/results.h"

// The sanitizers' shadow memory takes more than any limit.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
namespace b4mrl {
namespace {

TEST_CASE("A text that may take more memory than there is is refused before it is read") {
  std::string many = "{\"scorings\": [0";
  while (many.size() + 4 < kMaxResultBytes) many += ",0";
  many += "]}";
  {
    // To be read, the numbers take 48 MiB at their list's last growth, and to be destroyed, 80.
    const ResourceLimit left(RLIMIT_AS, AddressesInUse() + (64 << 20));
    const Status refused = ParseJsonObject(many, "many.json").status();
    CHECK(refused.code() == StatusCode::kLimitExceeded);
    CHECK(refused.message().find("not enough memory to read many.json") != std::string::npos);
    RequireOk(ParseJsonObject("{\"scorings\": [0]}", "few.json").status());
  }
  RequireOk(ParseJsonObject(many, "many.json").status());
}

TEST_CASE(
    "An object with more entries than a reader can look through is refused before it is read") {
  const auto with = [](int entries) {
    std::string text = "{\"a:{\\\"\": 1";
    for (int i = 1; i < entries; ++i) text += ", \"" + std::to_string(i) + "\": {\"b\": [1]}";
    return text + "}";
  };
  RequireOk(ParseJsonObject(with(1'000), "most.json").status());
  const Status refused = ParseJsonObject(with(1'001), "many.json").status();
  CHECK(refused.code() == StatusCode::kLimitExceeded);
  CHECK(refused.message() == "many.json has an object with more than 1000 entries");
  const std::string no_json = std::string(1'000, ']') + std::string(900, '[') + "{\"a\":";
  CHECK(ParseJsonObject(no_json, "none.json").status().code() == StatusCode::kDataLoss);
}

}  // namespace
}  // namespace b4mrl
#endif

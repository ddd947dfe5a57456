// JSON that others have written is refused where there is no memory for it.
#include "benchmarks/records/json_file.h"

#include <sys/resource.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <fstream>
#include <string>

#include "tests/results.h"

// The sanitizers' shadow memory takes more than any limit.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
namespace b4mrl {
namespace {

// While it lives, this process may have so many bytes of addresses beside those that it has.
class AddressesLeft {
 public:
  explicit AddressesLeft(rlim_t bytes) {
    rlim_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    REQUIRE(getrlimit(RLIMIT_AS, &before_) == 0);
    const rlimit limit{pages * static_cast<rlim_t>(sysconf(_SC_PAGESIZE)) + bytes,
                       before_.rlim_max};
    REQUIRE(setrlimit(RLIMIT_AS, &limit) == 0);
  }
  ~AddressesLeft() { setrlimit(RLIMIT_AS, &before_); }
  AddressesLeft(const AddressesLeft&) = delete;
  AddressesLeft& operator=(const AddressesLeft&) = delete;

 private:
  rlimit before_{};
};

TEST_CASE("A text that may take more memory than there is is refused before it is read") {
  std::string many = "{\"scorings\": [0";
  while (many.size() + 4 < kMaxResultBytes) many += ",0";
  many += "]}";
  {
    // To be read, the numbers take 48 MiB at their list's last growth, and to be destroyed, 80.
    const AddressesLeft left(64 << 20);
    const Status refused = ParseJsonObject(many, "many.json").status();
    CHECK(refused.code() == StatusCode::kLimitExceeded);
    CHECK(refused.message().find("not enough memory to read many.json") != std::string::npos);
    RequireOk(ParseJsonObject("{\"scorings\": [0]}", "few.json").status());
  }
  RequireOk(ParseJsonObject(many, "many.json").status());
}

}  // namespace
}  // namespace b4mrl
#endif

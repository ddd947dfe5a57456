#include "server/process/joined_scans.h"

#include <catch2/catch.hpp>
#include <set>

namespace b4mrl {
namespace {

using Ids = std::vector<uint64_t>;

struct ScansFixture {
  std::set<uint64_t> answered;
  std::vector<Ids> begun;
  JoinedScans scans{{.waits = [this](uint64_t id) { return !answered.contains(id); },
                     .scan = [this](Ids ids) { begun.push_back(std::move(ids)); }}};

  // The scan under way ends, and has answered its requests.
  void End() {
    for (const uint64_t id : begun.back()) answered.insert(id);
    scans.EndScan();
  }
};

TEST_CASE("Requests that come while a scan runs join one scan, which begins after it") {
  ScansFixture fixture;
  for (const uint64_t id : {1, 2, 3, 4}) fixture.scans.Join(id);
  REQUIRE(fixture.begun == std::vector<Ids>{{1}});
  fixture.End();
  REQUIRE(fixture.begun == std::vector<Ids>{{1}, {2, 3, 4}});
  fixture.scans.Join(5);
  fixture.End();
  fixture.End();
  REQUIRE(fixture.begun == std::vector<Ids>{{1}, {2, 3, 4}, {5}});
  fixture.scans.Join(6);
  REQUIRE(fixture.begun.size() == 4);
}

TEST_CASE("Requests that were answered at their deadline cause no scan") {
  ScansFixture fixture;
  fixture.scans.Join(1);
  for (uint64_t id = 2; id < 1000; ++id) {
    fixture.scans.Join(id);
    fixture.answered.insert(id);
  }
  fixture.End();
  REQUIRE(fixture.begun == std::vector<Ids>{{1}});
  fixture.scans.Join(1000);
  fixture.scans.Join(1001);
  fixture.scans.Join(1002);
  fixture.answered.insert(1001);
  fixture.End();
  REQUIRE(fixture.begun == std::vector<Ids>{{1}, {1000}, {1002}});
}

}  // namespace
}  // namespace b4mrl

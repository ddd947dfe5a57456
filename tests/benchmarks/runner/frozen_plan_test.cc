#include "benchmarks/runner/frozen_plan.h"

#include <catch2/catch.hpp>
#include <string>
#include <thread>
#include <vector>

#include "data/files/atomic_file.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

using Ids = std::vector<std::string>;

std::vector<PlannedRun> PlanOf(const std::string& id) {
  PlannedRun run;
  run.id = id;
  return {run};
}

TEST_CASE("The first list of runs stays, whatever is planned later") {
  const TemporaryFolder folder;
  CHECK(*FreezePlan(folder.path(), PlanOf("a")) == Ids{"a"});
  CHECK(*FreezePlan(folder.path(), PlanOf("b")) == Ids{"a"});
}

TEST_CASE("A list of runs that another process is writing is waited for and taken") {
  const TemporaryFolder folder;
  auto other = AtomicFile::Create(folder.File("plan.json"));
  REQUIRE(other.ok());
  Result<Ids> frozen = Ids{};
  std::thread waiting([&] { frozen = FreezePlan(folder.path(), PlanOf("b")); });
  CHECK(other->Write(R"({"runs": [{"id": "a"}]})").ok());
  CHECK(other->Commit().ok());
  waiting.join();
  REQUIRE(frozen.ok());
  CHECK(*frozen == Ids{"a"});
}

TEST_CASE("A list of runs is written by whoever comes after a process that has left none") {
  const TemporaryFolder folder;
  Result<Ids> frozen = Ids{};
  std::thread waiting;
  {
    const auto other = AtomicFile::Create(folder.File("plan.json"));
    REQUIRE(other.ok());
    waiting = std::thread([&] { frozen = FreezePlan(folder.path(), PlanOf("b")); });
  }
  waiting.join();
  REQUIRE(frozen.ok());
  CHECK(*frozen == Ids{"b"});
}

}  // namespace
}  // namespace b4mrl

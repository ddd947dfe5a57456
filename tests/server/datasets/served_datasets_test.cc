// Which datasets a worker keeps mapped.
#include "server/datasets/served_datasets.h"

#include <catch2/catch.hpp>

#include "proto/base/limits.h"
#include "tests/server/datasets/store_fixture.h"

namespace b4mrl {
namespace {

std::string Fingerprint(uint32_t i) { return "dataset " + std::to_string(i); }

TEST_CASE("the dataset that was used longest ago makes room for another one") {
  const StoreFixture files;
  const std::shared_ptr<const Dataset> dataset = files.OpenMade("").value().dataset;
  ServedDatasets served;
  for (uint32_t i = 0; i < limits::kMaxMappedDatasets; ++i) served.Add(Fingerprint(i), dataset);
  for (uint32_t i = 0; i < limits::kMaxMappedDatasets; ++i) CHECK(served.Find(Fingerprint(i)));
  // A use by name and one by fingerprint; the third is the one that was used longest ago.
  served.Add(Fingerprint(0), dataset);
  REQUIRE(served.Find(Fingerprint(1)));
  served.Add("one more", dataset);
  CHECK_FALSE(served.Find(Fingerprint(2)));
  CHECK(served.Find("one more"));
  for (uint32_t i = 0; i < limits::kMaxMappedDatasets; ++i) {
    if (i != 2) CHECK(served.Find(Fingerprint(i)));
  }
}

}  // namespace
}  // namespace b4mrl

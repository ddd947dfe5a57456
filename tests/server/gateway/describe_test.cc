#include "server/gateway/describe.h"

#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

TEST_CASE("Hello names the server's capabilities, a door where there is one") {
  std::vector<std::string> expected = {"step",     "query",  "snapshot", "render",
                                       "datasets", "status", "relay",    "ledger"};
  const bool has_doors = GENERATE(false, true);
  if (has_doors) expected.push_back("door");
  pb::HelloReply hello;
  DescribeServer(1, has_doors, &hello);
  const std::vector<std::string> told(hello.capabilities().begin(), hello.capabilities().end());
  CHECK(told == expected);
}

TEST_CASE("Hello tells each limit under its own name") {
  pb::HelloReply hello;
  DescribeServer(7'000, false, &hello);
  CHECK(hello.limits().max_envelope_bytes() == limits::kMaxEnvelopeBytes);
  CHECK(hello.limits().max_payload_bytes() == limits::kMaxPayloadBytes);
  CHECK(hello.limits().max_sessions() == limits::kMaxSessions);
  CHECK(hello.limits().max_lanes_per_session() == limits::kMaxLanesPerSession);
  CHECK(hello.limits().max_requests_in_flight() == limits::kMaxRequestsInFlight);
  CHECK(hello.limits().max_query_rows() == limits::kMaxQueryRows);
  CHECK(hello.limits().max_rows_per_batch() == limits::kMaxRowsPerBatch);
  CHECK(hello.limits().session_lease_ms() == 7'000);
}

}  // namespace
}  // namespace b4mrl

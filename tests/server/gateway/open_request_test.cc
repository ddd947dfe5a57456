// The greatest Open that the gateway takes, and what it adds to it.
#include "server/gateway/open_request.h"

#include <catch2/catch.hpp>
#include <climits>
#include <string>

#include "proto/base/limits.h"
#include "server/shared_memory/session_table.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

const std::string kOpenToken(limits::kTokenBytes, 't');

// A request that leaves seed and dtype to the gateway.
pb::OpenRequest OpenOfBytes(size_t bytes) {
  pb::OpenRequest open;
  open.set_environment("HalfCheetah");
  while (open.ByteSizeLong() < bytes) *open.mutable_config() += ' ';
  return open;
}

TEST_CASE("What a client sends is measured, not what the gateway adds to it") {
  pb::OpenRequest open = OpenOfBytes(limits::kMaxOpenRequestBytes);
  RequireOk(CompleteOpen(kOpenToken, &open));
  CHECK(open.has_seed());
  CHECK(open.ByteSizeLong() > limits::kMaxOpenRequestBytes);
  open.set_seed(UINT64_MAX);                            // the longest there is,
  open.set_compiled_model(std::string(PATH_MAX, 'm'));  // as is this path

  SharedState state = Take(SharedState::Create(1, 1'000));
  const std::string bytes = open.SerializeAsString();
  const uint32_t index = Take(SessionTable(state).Allocate({kOpenToken, bytes, 1, 0}));
  RequireOk(CheckSessionRecord(state.session(index)));
  CHECK(SessionOpenBytes(state.session(index)) == bytes);
}

TEST_CASE("A larger Open is refused with its size, and no record takes more than its room") {
  pb::OpenRequest open = OpenOfBytes(limits::kMaxOpenRequestBytes + 1);
  const Status status = CompleteOpen(kOpenToken, &open);
  CHECK(status.code() == StatusCode::kInvalidArgument);
  CHECK(status.message() == "bytes of the Open request is 8193, allowed: at most 8192");

  SharedState state = Take(SharedState::Create(1, 1'000));
  const std::string bytes(limits::kMaxOpenRecordBytes + 1, 'b');
  CHECK(SessionTable(state).Allocate({kOpenToken, bytes, 1, 0}).status().code() ==
        StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace b4mrl

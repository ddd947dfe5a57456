// A daemon for tests of sessions and datasets: one socket plays the gateway and every worker. What
// it is asked goes through hooks, and is kept for the test to look at afterwards.
#pragma once

#include <functional>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "client/client.h"
#include "tests/client/fake_server.h"

namespace b4mrl {

inline constexpr size_t kObservationSize = 3;
inline constexpr size_t kActionSize = 2;

// What one row of a dataset is full of. Its terminal is 0.
struct FakeRow {
  float observation, action, reward, next_observation;
};

class FakeDaemon {
 public:
  // Returns true if it has answered (or wants no answer); otherwise the default answer is given.
  using Hook = std::function<bool(FakeServer&, FakeCall&)>;

  explicit FakeDaemon(Hook hook = {})
      : hook_(std::move(hook)),
        server_(folder_.Address(), [this](FakeServer& server, FakeCall& call) {
          if (hook_ && hook_(server, call)) return;
          Answer(server, call);
        }) {}

  // The default answer; for hooks.
  void Answer(FakeServer& server, FakeCall& call);
  // The answer to a Sample or Read with other rows; for hooks. `row` is given numbers from 0 on.
  static void AnswerRows(FakeServer& server, const FakeCall& call, uint64_t rows,
                         const std::function<FakeRow(uint64_t)>& row);
  // How many a Sample asks for, all batches together.
  static uint64_t RowsOf(const pb::SampleRequest& sample);

  std::string address() const { return folder_.Address(); }
  // Of the session that is opened next; set before the client connects.
  pb::OpenReply open_reply;
  bool has_ports = true;  // whether workers can be reached
  uint32_t protocol_version = limits::kProtocolVersion;
  uint64_t session_lease_ms = 0;  // which Hello says; 0: nothing. No session ends by it.
  uint64_t dataset_rows = 100;
  std::string dataset_environment = "Fake";
  std::vector<uint32_t> hidden_dimensions;  // of the dataset

  // Sessions that were given back; a Close that comes twice counts once.
  uint64_t closed_sessions() const {
    const std::lock_guard lock(mutex_);
    return closed_tokens_.size();
  }

 private:
  void AnswerOpen(FakeServer& server, const FakeCall& call);
  void AnswerLanes(FakeServer& server, const FakeCall& call);
  void AnswerQuery(FakeServer& server, const FakeCall& call);
  void AnswerDatasetStats(FakeServer& server, const FakeCall& call);
  void AnswerDatasetRows(FakeServer& server, const FakeCall& call);

  SocketFolder folder_;
  mutable std::mutex mutex_;
  std::set<std::string> closed_tokens_;  // under mutex_
  uint32_t num_envs_ = 0;
  Hook hook_;
  FakeServerThread server_;  // last: its thread uses the members above
};

// The elements of one array of a request or reply.
template <typename T>
std::vector<T> Elements(const google::protobuf::RepeatedPtrField<pb::Array>& table,
                        const Frame& payload, std::string_view name) {
  const Result<ArrayReader> arrays = ArrayReader::Parse(table, payload);
  const TensorView* view = arrays.ok() ? arrays->Find(name) : nullptr;
  if (view == nullptr || view->dtype != DTypeOf<T>()) return {};
  const std::span<const T> values = view->template As<T>();
  return {values.begin(), values.end()};
}
template <typename T>
std::vector<T> Elements(const FakeCall& call, std::string_view name) {
  return Elements<T>(call.request.arrays(), call.payload, name);
}

}  // namespace b4mrl

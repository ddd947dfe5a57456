// A Step, Reset or Restore under construction: its arrays and the next number of each of its lanes.
// Part of RemoteEnvironment; lives on the stack of one call.
#pragma once

#include <cstring>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "client/remote_environment.h"

namespace b4mrl {

class RemoteEnvironment::NumberedRequest {
 public:
  // `session` and `lanes` outlive the request. An empty list means all lanes.
  NumberedRequest(RemoteEnvironment& session, std::span<const uint32_t> lanes)
      : session_(session), lanes_(lanes), layout_(request_.mutable_arrays()) {
    const uint64_t count = session.numbers_.CountOf(lanes);
    numbers_offset_ = layout_.Add("numbers", DType::kUint64, {count});
    if (!lanes.empty()) Add("lanes", lanes, {count});
  }

  pb::Request& request() { return request_; }

  // Adds an array; `values` has as many elements as `shape` and lives until Send.
  template <typename T>
  void Add(std::string_view name, std::span<const T> values,
           std::initializer_list<uint64_t> shape) {
    const size_t offset = layout_.Add(name, DTypeOf<T>(), shape);
    parts_.push_back({offset, values.data(), values.size_bytes()});
  }

  // Sends the request and marks its lanes as busy; returns the request's id.
  Result<uint64_t> Send() {
    const size_t count = session_.numbers_.CountOf(lanes_);
    B4MRL_ASSIGN_OR_RETURN(Frame payload, AllocatePayload(layout_));
    B4MRL_RETURN_IF_ERROR(
        session_.numbers_.Begin(lanes_, ArrayAt<uint64_t>(payload, numbers_offset_, count)));
    for (const Part& part : parts_) {
      if (part.bytes > 0) std::memcpy(payload.data() + part.offset, part.data, part.bytes);
    }
    Result<uint64_t> id =
        session_.connection_->Send(std::move(request_), std::move(payload), session_.NewDeadline());
    if (id.ok()) {
      session_.under_way_.push_back({*id, {lanes_.begin(), lanes_.end()}});
    } else {
      session_.numbers_.End(lanes_, LaneNumbers::Outcome::kNotExecuted);
    }
    return id;
  }

 private:
  struct Part {
    size_t offset;
    const void* data;
    size_t bytes;
  };

  RemoteEnvironment& session_;
  std::span<const uint32_t> lanes_;
  pb::Request request_;
  ArrayLayout layout_;
  size_t numbers_offset_ = 0;
  std::vector<Part> parts_;
};

}  // namespace b4mrl

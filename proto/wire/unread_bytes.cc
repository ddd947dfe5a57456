#include "proto/wire/unread_bytes.h"

#include <fmt/format.h>
#include <zmq.h>

#include <cstdlib>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {

struct UnreadBytes::Counted {
  Frame bytes;
  std::shared_ptr<Counter> all;
  std::shared_ptr<Counter> of_receiver;
};

Status UnreadBytes::Count(const std::string& receiver, Message* message) {
  for (Frame* frame : {&message->envelope, &message->payload}) {
    if (frame->size() < limits::kCountedFrameBytes) continue;
    B4MRL_ASSIGN_OR_RETURN(*frame, Count(receiver, std::move(*frame)));
  }
  return Status();
}

Result<Frame> UnreadBytes::Count(const std::string& receiver, Frame given) {
  const size_t bytes = given.size();
  const std::shared_ptr<Counter>& of_receiver = CounterOf(receiver);
  if (*of_receiver + bytes > limits::kMaxUnreadBytes ||
      *all_ + bytes > limits::kMaxUnreadBytesOfAll) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("the peer has {} bytes to read, all have {}, at most {} and {}",
                              of_receiver->load(), all_->load(), limits::kMaxUnreadBytes,
                              limits::kMaxUnreadBytesOfAll));
  }
  *of_receiver += bytes;
  *all_ += bytes;
  Counted* const counted = new Counted{std::move(given), all_, of_receiver};  // see Release
  Frame frame;
  zmq_msg_t* const message = static_cast<zmq_msg_t*>(frame.handle());
  zmq_msg_close(message);
  // Only fails when memory is exhausted, like Frame::OfSize.
  if (zmq_msg_init_data(message, counted->bytes.data(), bytes, &Release, counted) != 0) {
    std::abort();
  }
  return frame;
}

size_t UnreadBytes::of(const std::string& receiver) const {
  const auto found = receivers_.find(receiver);
  return found == receivers_.end() ? 0 : found->second->load();
}

void UnreadBytes::Release(void*, void* counted) {
  const std::unique_ptr<Counted> released(static_cast<Counted*>(counted));
  const size_t bytes = released->bytes.size();
  *released->of_receiver -= bytes;
  *released->all -= bytes;
}

std::shared_ptr<UnreadBytes::Counter>& UnreadBytes::CounterOf(const std::string& receiver) {
  const auto found = receivers_.find(receiver);
  if (found != receivers_.end()) return found->second;
  // Peers come and go; counters of peers that hold no bytes are removed whenever a peer is added.
  std::erase_if(receivers_, [](const auto& entry) { return *entry.second == 0; });
  return receivers_.emplace(receiver, std::make_shared<Counter>(0)).first->second;
}

}  // namespace b4mrl

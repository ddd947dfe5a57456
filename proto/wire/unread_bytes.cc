#include "proto/wire/unread_bytes.h"

#include <fmt/format.h>
#include <zmq.h>

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

size_t CountedBytes(const Frame& frame) {
  return frame.size() < limits::kCountedFrameBytes ? 0 : frame.size();
}

}  // namespace

struct UnreadBytes::Counted {
  Frame bytes;
  std::shared_ptr<Counter> all;
  std::shared_ptr<Counter> of_receiver;
};

UnreadBytes UnreadBytes::Beside() const {
  UnreadBytes beside(limits_);
  beside.all_ = all_;
  return beside;
}

Status UnreadBytes::Count(const std::string& receiver, Message* message) {
  Frame* const frames[] = {&message->envelope, &message->payload};
  size_t bytes = 0;
  for (const Frame* frame : frames) bytes += CountedBytes(*frame);
  if (bytes == 0) return Status();
  const std::shared_ptr<Counter>& of_receiver = CounterOf(receiver);
  B4MRL_RETURN_IF_ERROR(Admit(*of_receiver, bytes));
  for (Frame* frame : frames) {
    if (CountedBytes(*frame) > 0) *frame = Wrap(of_receiver, std::move(*frame));
  }
  return Status();
}

Status UnreadBytes::Admit(size_t of_one, size_t bytes) const {
  const size_t of_all = *all_;
  const size_t then = of_all + bytes;
  const size_t left = then < limits_.of_all ? limits_.of_all - then : 0;
  const size_t most = std::max(std::min(limits_.of_one, left), limits::kReservedUnreadBytes);
  if (of_all == 0 || of_one + bytes <= most) return Status();
  return Status(StatusCode::kLimitExceeded,
                fmt::format("the peer would have {} bytes to read, at most {}; all have {} of {}",
                            of_one + bytes, most, of_all, limits_.of_all));
}

Frame UnreadBytes::Wrap(const std::shared_ptr<Counter>& of_receiver, Frame given) {
  const size_t bytes = given.size();
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

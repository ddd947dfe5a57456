#include "tests/conformance/peer.h"

#include <zmq.h>

#include <utility>

#include "proto/base/limits.h"

namespace b4mrl::conformance {

Result<Peer> Peer::AtSocket(Context& context, const std::string& address) {
  B4MRL_ASSIGN_OR_RETURN(DealerSocket socket, DealerSocket::Connect(context, address));
  Peer peer;
  peer.socket_.emplace(std::move(socket));
  return peer;
}

Result<Peer> Peer::AtDoor(const std::string& name) {
  B4MRL_ASSIGN_OR_RETURN(ClientDoor door,
                         ClientDoor::Connect(name, Deadline::AfterMs(limits::kDirectConnectMs)));
  Peer peer;
  peer.door_.emplace(std::move(door));
  return peer;
}

bool Peer::FitsDoor(const std::vector<std::string>& frames) {
  return (frames.size() == 1 || frames.size() == 2) &&
         frames.front().size() <= limits::kMaxEnvelopeBytes &&
         frames.back().size() <= limits::kMaxPayloadBytes;
}

Status Peer::Send(Message message) {
  return door_ ? door_->Send(std::move(message)) : socket_->Send(std::move(message));
}

Status Peer::SendFrames(const std::vector<std::string>& frames) {
  if (door_) {
    return door_->Send(
        {Frame::Copy(frames.front()), frames.size() > 1 ? Frame::Copy(frames.back()) : Frame()});
  }
  for (size_t i = 0; i < frames.size(); ++i) {
    const int flags = ZMQ_DONTWAIT | (i + 1 < frames.size() ? ZMQ_SNDMORE : 0);
    if (zmq_send(socket_->handle(), frames[i].data(), frames[i].size(), flags) >= 0) continue;
    return {StatusCode::kUnavailable, "the queue towards the server is full"};
  }
  return Status();
}

std::optional<Message> Peer::TryReceive() {
  return door_ ? door_->Receive(Deadline::AfterMs(0)) : socket_->TryReceive();
}

}  // namespace b4mrl::conformance

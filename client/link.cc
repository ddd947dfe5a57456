#include "client/link.h"

#include <utility>

namespace b4mrl {

Result<Link> Link::Open(const Context& context, const std::string& address, const std::string& door,
                        const Deadline& deadline, const std::atomic<bool>* cancelled) {
  Link link(context, address);
  if (!door.empty()) {
    Result<ClientDoor> opened = ClientDoor::Connect(door, deadline, cancelled);
    if (opened.ok()) {
      link.door_.emplace(std::move(*opened));
      return link;
    }
  }
  B4MRL_RETURN_IF_ERROR(link.OpenSocket());
  return link;
}

Status Link::OpenSocket() {
  B4MRL_ASSIGN_OR_RETURN(DealerSocket socket, DealerSocket::Connect(context_, address_));
  socket_.emplace(std::move(socket));
  return Status();
}

Status Link::Send(Message message) {
  return door_ ? door_->Send(std::move(message)) : socket_->Send(std::move(message));
}

std::optional<Message> Link::Receive(const Deadline& deadline) {
  if (!door_) return socket_->Receive(deadline);
  std::optional<Message> message = door_->Receive(deadline);
  // Without an address, or a socket, the door is tried on and on.
  if (door_->is_refused() && OpenSocket().ok()) {
    earlier_connections_ = door_->connections();
    door_.reset();
  }
  return message;
}

void Link::Wait(const Deadline& deadline) {
  if (socket_) socket_->Wait(deadline);
}

uint32_t Link::connections() {
  return earlier_connections_ + (door_ ? door_->connections() : socket_->connections());
}

std::string_view Link::transport() const {
  if (door_) return "door";
  return address_.starts_with("ipc://") ? "ipc" : "tcp";
}

}  // namespace b4mrl

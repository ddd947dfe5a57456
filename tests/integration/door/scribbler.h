// A client of a local door (proto/wire/door.h) that breaks every rule. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "proto/base/unique_fd.h"
#include "proto/wire/door.h"

namespace b4mrl {

// A connection to the door, invalid if nobody listens; reads from it wait for 10 s at most.
UniqueFd ConnectTo(const std::string& door);
// Receives a greeting and the memory's descriptor, which is invalid if none comes.
UniqueFd ReceiveGreeting(int socket, DoorGreeting* greeting);
// One datagram with a descriptor.
void SendWithDescriptor(int socket, const void* data, size_t size, int fd);

// Makes a connection and puts random words, lengths, bytes and bells into it, which `seed` draws.
// False if there was no greeting, or if the memory could be shrunk.
bool Scribble(const std::string& door, uint64_t seed);

}  // namespace b4mrl

// A client of a local door (proto/wire/door.h) that breaks every rule. Any thread.
#pragma once

#include <cstdint>
#include <string>

namespace b4mrl {

// Makes a connection and puts random words, lengths, bytes and bells into it, which `seed` draws.
// False if there was no greeting, or if the memory could be shrunk.
bool Scribble(const std::string& door, uint64_t seed);

}  // namespace b4mrl

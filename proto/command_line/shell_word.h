// A word of a command line as a shell reads it back: quoted where it must be. Pure function; any
// thread.
#pragma once

#include <string>
#include <string_view>

namespace b4mrl {

std::string ShellWord(std::string_view word);  // "" becomes ''

}  // namespace b4mrl

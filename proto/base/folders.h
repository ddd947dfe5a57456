// Where programs look when they are told no folder. Any thread, as long as nobody changes the
// process's environment variables meanwhile.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace b4mrl {

// Where datasets live: $B4MRL_DATA, else $XDG_DATA_HOME/b4mrl, else $HOME/.local/share/b4mrl, else
// /var/lib/.local/share/b4mrl. It need not exist. A relative XDG_DATA_HOME or HOME is passed over,
// as the XDG specification asks: the daemon and a command in another folder would mean two places
// by it.
std::string DefaultDataFolder();

// A number that tells the folder from every other one, on this host (until it boots again) and on
// others, whatever path leads to it: two processes that compute the same number for their paths can
// leave files there for each other. 0 where the folder or the kernel says too little.
uint64_t FolderIdentity(const std::string& path);

// A folder of files that come with the project ("models", "agents"): ../share/b4mrl/`name` as seen
// from the running program's folder if there is one, as `cmake --install` makes it; otherwise
// `in_source_tree`, known to the build. So an installation can be moved as a whole.
std::string SharedFolder(std::string_view name, const std::string& in_source_tree);

}  // namespace b4mrl

// The folders that programs use by default. Any thread, as long as no thread changes the process's
// environment variables meanwhile.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace b4mrl {

// The default folder of datasets: $B4MRL_DATA, else $XDG_DATA_HOME/b4mrl, else
// $HOME/.local/share/b4mrl, else /var/lib/.local/share/b4mrl. It need not exist. A relative
// XDG_DATA_HOME or HOME is ignored, as the XDG specification asks: it would name different folders
// for a daemon and a command with different working directories.
std::string DefaultDataFolder();

// The user's folder of files that can be made again: $XDG_CACHE_HOME/b4mrl, else
// $HOME/.cache/b4mrl, else "". It need not exist.
std::string DefaultCacheFolder();

// A number that identifies the folder among all folders of all hosts, whatever path leads to it,
// until its host boots again: two processes that compute equal numbers for their paths can exchange
// files there. 0 if the folder or the kernel's boot id cannot be read.
uint64_t FolderIdentity(const std::string& path);

// A folder of files that come with the project ("models", "agents"): ../lib/b4mrl/`name` relative
// to the running program's folder if that exists, as `cmake --install` makes it; otherwise
// `in_source_tree`, known to the build. So an installation can be moved as a whole. The place is
// not share/b4mrl, because that is the user's data folder where the prefix is ~/.local.
std::string SharedFolder(std::string_view name, const std::string& in_source_tree);

}  // namespace b4mrl

// What systemd learns of the daemon, if it has started it (Type=notify).
#pragma once

#include <string_view>

namespace b4mrl {

// Sends `state`, such as "READY=1", to the socket that $NOTIFY_SOCKET names, as sd_notify(3) says.
// Does nothing without one; does not wait, and what cannot be sent is dropped. One thread, as the
// environment is read.
void TellServiceManager(std::string_view state);

}  // namespace b4mrl

// What systemd learns of the daemon, if it has started it (Type=notify).
#pragma once

#include <string_view>

namespace b4mrl {

// Sends `state`, such as "READY=1", to the socket that $NOTIFY_SOCKET names, as sd_notify(3) says;
// waits at most a second. Does nothing without one, or where systemd has started another process of
// which this one has the variables ($SYSTEMD_EXEC_PID). False if it could not be sent. One thread,
// as the environment is read.
bool TellServiceManager(std::string_view state);

}  // namespace b4mrl

// Starting a program, speaking to it and waiting for its end; and the private folder in which two
// programs may meet. Any thread.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

// The path of `name` in the folder of the running program.
std::string ProgramBesideThisOne(std::string_view name);

struct ProgramOnSocket {
  pid_t process_id = 0;
  UniqueFd socket;  // our end; its end is the program's stdin
};

// Starts `program` (searched in PATH if it has no slash) with the arguments `words`, of which the
// first is its name. A socket rather than a pipe, because writing to it can be told not to raise
// SIGPIPE. The program's stdout is our stderr; it gets no other descriptor. Returns 0, or the errno
// of what failed.
int StartOnSocket(const std::string& program, std::vector<std::string> words,
                  ProgramOnSocket* started);

struct ProgramWithOutput {
  pid_t process_id = 0;
  UniqueFd output;  // what it writes to its stdout
};

// Starts a program that reads nothing and whose stdout is read through a pipe; its stderr is ours.
// It leads a process group of its own: a terminal's interrupt is for this program to answer.
// Returns 0, or the errno of what failed.
int StartWithOutput(const std::string& program, std::vector<std::string> words,
                    ProgramWithOutput* started);

// Sends everything through a socket. kDeadlineExceeded, or kUnavailable when the other end is gone.
Status SendAll(int socket, std::span<const std::byte> bytes, const Deadline& deadline);

// Waits until `fd` is ready for one of poll's `events`; kDeadlineExceeded.
Status WaitUntilReady(int fd, short events, const Deadline& deadline);

// Waits for the exit of a child and enforces it at the deadline. Returns what waitpid reports.
int WaitForExit(pid_t child, const Deadline& deadline);

// A new folder "<name>-XXXXXX" in $TMPDIR or /tmp, for this user alone.
Result<std::string> MakeTemporaryFolder(std::string_view name);

}  // namespace b4mrl

// Starts programs, exchanges bytes with them and waits for their end; makes private folders, for
// the sockets of two programs and what is needed for a while. Any thread.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

// The path of the running program; "" if the system does not tell.
std::string ThisProgram();
// The path of `name` in the folder of the running program.
std::string ProgramBesideThisOne(std::string_view name);

// This process's variables with `added` ("NAME=value") in the places of those of equal names.
std::vector<std::string> EnvironmentWith(const std::vector<std::string>& added);
// The texts as the system's calls take them, with a null pointer at the end. Valid as long as they.
std::vector<char*> PointersTo(std::vector<std::string>& texts);

// For a new process between fork and exec, by system calls alone: stdin reads nothing, stdout and
// stderr become these descriptors, and no other stays open but `kept`, unless that is negative.
void TakeStreams(int output, int errors, int kept = -1);

struct ProgramOnSocket {
  pid_t process_id = 0;
  UniqueFd socket;  // our end of the socket pair, whose other end is the program's stdin
};

// Starts `program` (searched in PATH if it has no slash) with the arguments `words`, of which the
// first is its name. Its stdin is a socket and not a pipe, because writes to a socket can be told
// not to raise SIGPIPE. Its stdout and stderr are our stderr; it gets no other descriptor. Returns
// 0, or the errno of the call that failed.
int StartOnSocket(const std::string& program, std::vector<std::string> words,
                  ProgramOnSocket* started);

struct ProgramWithOutput {
  pid_t process_id = 0;
  UniqueFd output;  // reads the program's stdout
};

// Starts a program that reads nothing and whose stdout is read through a pipe; its stderr is ours.
// It leads its own process group, so a terminal's interrupt reaches the calling process alone. It
// has these variables ("NAME=value"), or this process's. Returns 0, or the errno of the call that
// failed.
int StartWithOutput(const std::string& program, std::vector<std::string> words,
                    ProgramWithOutput* started,
                    std::optional<std::vector<std::string>> variables = {});

// Sends all of `bytes` through a socket. kDeadlineExceeded, or kUnavailable if the other end is
// closed.
Status SendAll(int socket, std::span<const std::byte> bytes, const Deadline& deadline);

// Waits until `fd` is ready for one of poll's `events`; kDeadlineExceeded if it is not in time.
Status WaitUntilReady(int fd, short events, const Deadline& deadline);

// Waits for the exit of a child process and kills it at the deadline. Returns waitpid's wait
// status.
int WaitForExit(pid_t child, const Deadline& deadline);

// Makes a new folder "<name>-XXXXXX" in $TMPDIR, or in /tmp where that is not set or too long for
// the addresses of sockets below it, which have 107 bytes at most. Only this user may enter it.
Result<std::string> MakeTemporaryFolder(std::string_view name);

// Removes a folder and all in it when it goes.
class FolderRemover {
 public:
  explicit FolderRemover(std::string path) : path_(std::move(path)) {}
  ~FolderRemover();
  FolderRemover(const FolderRemover&) = delete;
  FolderRemover& operator=(const FolderRemover&) = delete;
  const std::string& path() const { return path_; }

 private:
  const std::string path_;
};

}  // namespace b4mrl

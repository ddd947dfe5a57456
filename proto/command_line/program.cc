#include "proto/command_line/program.h"

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <string>
#include <system_error>

#include "proto/base/exit_codes.h"
#include "proto/base/status.h"

namespace b4mrl {

int RunProgram(std::string_view name, const std::function<int()>& body) {
  // Ignored by a parent, it would leave no child's end to wait for.
  std::signal(SIGCHLD, SIG_DFL);
  // A write beyond the limit on file sizes is to fail like one on a full disk.
  std::signal(SIGXFSZ, SIG_IGN);
  int exit_code = kExitDone;
  int error = 0;
  std::string_view stream = "stdout";
  try {
    exit_code = body();
    if (std::fflush(stdout) != 0) {
      error = errno;
    } else if (std::ferror(stdout) != 0) {
      error = EIO;  // nobody kept the number of an earlier error
    }
  } catch (const std::system_error& caught) {
    // fmt::print throws where a stream takes no more. Nothing else of the project throws this on
    // purpose.
    if (std::ferror(stdout) == 0 && std::ferror(stderr) == 0) throw;
    error = caught.code().value();
    if (std::ferror(stdout) == 0) stream = "stderr";
  }
  if (error == 0) return exit_code;
  if (error == EPIPE) return 128 + SIGPIPE;
  const Status status = IoError("write", stream, error);
  // Not by fmt::print, since stderr may be where nothing can be written.
  std::fputs((std::string(name) + ": " + status.message() + "\n").c_str(), stderr);
  return exit_code == kExitDone ? kExitBadInput : exit_code;
}

}  // namespace b4mrl

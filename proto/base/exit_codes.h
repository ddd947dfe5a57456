// Exit codes of all programs of the project.
#pragma once

namespace b4mrl {

enum ExitCode : int {
  kExitDone = 0,
  kExitFailed = 1,    // a bug in b4mrl, or a run that diverged
  kExitBadUsage = 2,  // invalid options
  kExitBadInput = 3,  // an input or output file or folder is unusable
  kExitNoDaemon = 4,  // the daemon cannot be reached or does not answer
  kExitRefused = 5,   // the daemon refused a request
  kExitBusy = 6,      // another process does the same at the moment; it may be tried again
  kExitInterrupted = 130,
};

}  // namespace b4mrl

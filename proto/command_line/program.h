// The frame of a program's main function.
#pragma once

#include <functional>
#include <string_view>

namespace b4mrl {

// Calls `body` and returns the program's exit code: that of `body`, but kExitBadInput instead of 0
// where stdout took less than was written, as on a full disk, or stderr less than `body` must
// write; the reason is then on stderr, as far as it goes there, behind the program's `name`. A
// reader of stdout that has gone, such as `head`, is no fault: nothing is said, and the code is a
// shell's for SIGPIPE, which ends the program before where it is not ignored. A write beyond the
// limit on file sizes (`ulimit -f`) fails and does not end the program. Call it once, from main; at
// its end stdout is flushed.
int RunProgram(std::string_view name, const std::function<int()>& body);

}  // namespace b4mrl

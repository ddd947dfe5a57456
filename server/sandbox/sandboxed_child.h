// Runs this program again in a role that reads untrusted files, and collects its one answer.
//
// The child inherits nothing but stderr; its stdin is /dev/null and its stdout a pipe. It prints
// one JSON object and exits: {"ok": true, ...} or {"ok": false, "code": 12, "message": "..."}.
// After 2 s it runs at lower priority. Any thread; the child dies with the thread that started it.
#pragma once

#include <atomic>
#include <string>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/status.h"

namespace b4mrl {

struct SandboxedChild {
  std::string program;
  std::vector<std::string> arguments;  // behind the program's name
  std::string name;                    // for messages: "the importer"
};

// Lists and objects of an answer inside each other. A crafted file may control the child.
inline constexpr int kMaxAnswerDepth = 8;

struct ChildAnswer {
  bool ended_well = false;   // with exit code 0; others may leave unfinished files
  Result<std::string> json;  // of an answer with "ok": true, nested to kMaxAnswerDepth at most
};

// Waits for the child's answer and its exit. An answer with "ok": false becomes the Status that it
// names; a death, no answer, too long or too deep an answer becomes kDataLoss, and SIGKILL, which
// the system sends when memory is short, kInternal. The child is ended within 100 ms of a missed
// deadline (kDeadlineExceeded) and of `cancelled` (may be null) turning true (kUnavailable), and
// two seconds after it has closed its output. The messages do not name the file, which the caller
// adds.
ChildAnswer RunSandboxedChild(const SandboxedChild& child, const Deadline& deadline,
                              const std::atomic<bool>* cancelled);

// For the child, to be called first: it is killed when the thread that started it ends, and at once
// if that has ended already.
void DieWithParent();
// For the child: the JSON text of an answer with "ok": false.
std::string ErrorAnswer(const Status& error);

}  // namespace b4mrl

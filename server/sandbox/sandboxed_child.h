// Runs this program again in a role that reads untrusted files, and collects its one answer.
//
// The child inherits nothing but stderr; its stdin is /dev/null and its stdout a pipe. It prints
// one JSON object and exits: {"ok": true, ...} or {"ok": false, "code": 12, "message": "..."}.
// After 2 s it runs at lower priority. Any thread; the child dies with the thread that started it.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <nlohmann/json_fwd.hpp>
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

struct ChildAnswer {
  pid_t process_id = -1;     // whose unfinished files may be left; -1: it did not start
  bool ended_well = false;   // it exited with code 0
  Result<std::string> json;  // of an answer with "ok": true
};

// Waits for the child's answer and its exit. An answer with "ok": false becomes its Status; a
// death, silence or too long an answer kDataLoss. A missed deadline (kDeadlineExceeded), or
// `cancelled` (may be null) turning true (kUnavailable), ends the child within 100 ms. Messages do
// not name the file: the caller adds it.
ChildAnswer RunSandboxedChild(const SandboxedChild& child, const Deadline& deadline,
                              const std::atomic<bool>* cancelled = nullptr);

// For the child's side: the answer of an error.
std::string ErrorAnswer(const Status& error);

}  // namespace b4mrl

// Loops of steps in Python (benchmarks/performance/python_rates.py), run by the `python3` of PATH
// in a process of its own, which ends with this object. One thread.
#pragma once

#include <sys/types.h>

#include <memory>
#include <set>
#include <string>
#include <utility>

#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl::perf {

class PythonLoops {
 public:
  // Starts Python with a client of the daemon at `endpoint`. kUnavailable if there is no python3,
  // or if it has no package b4mrl.
  static Result<std::unique_ptr<PythonLoops>> Start(const std::string& endpoint);
  ~PythonLoops();

  // Whether this Python has what the loop `name` needs.
  bool Has(const std::string& name) const { return names_.contains(name); }
  // Environment steps a second of the loop `name`, measured for about `seconds`. The first call of
  // a name makes its environments.
  Result<double> Rate(const std::string& name, double seconds);

 private:
  PythonLoops(pid_t process_id, UniqueFd socket)
      : process_id_(process_id), socket_(std::move(socket)) {}
  // The next line that Python sends; the reason if that is why it failed.
  Result<std::string> ReadLine(double seconds);

  pid_t process_id_;
  UniqueFd socket_;
  std::set<std::string> names_;
};

}  // namespace b4mrl::perf

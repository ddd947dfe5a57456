// Makes every file of this process fail to grow beyond a size, as a full disk would. For tests.
#pragma once

#include <sys/resource.h>

#include <csignal>

#include "tests/resource_limit.h"

namespace b4mrl {

class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : limit_(RLIMIT_FSIZE, bytes) {}

 private:
  // Files that are too long have an error instead of this signal.
  class SignalIgnored {
   public:
    SignalIgnored() : previous_(std::signal(SIGXFSZ, SIG_IGN)) {}
    ~SignalIgnored() { std::signal(SIGXFSZ, previous_); }
    SignalIgnored(const SignalIgnored&) = delete;
    SignalIgnored& operator=(const SignalIgnored&) = delete;

   private:
    void (*previous_)(int);
  };

  SignalIgnored ignored_;
  ResourceLimit limit_;
};

}  // namespace b4mrl

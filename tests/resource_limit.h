// Limits of this process, and of those that it starts, while an object lives. For tests.
#pragma once

#include <sys/resource.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <fstream>

namespace b4mrl {

// Lowers a limit, such as RLIMIT_AS, of the addresses of a process, in bytes.
class ResourceLimit {
 public:
  ResourceLimit(__rlimit_resource resource, rlim_t value) : resource_(resource) {
    REQUIRE(getrlimit(resource, &previous_) == 0);
    const rlimit limit{value, previous_.rlim_max};
    REQUIRE(setrlimit(resource, &limit) == 0);
  }
  ~ResourceLimit() { setrlimit(resource_, &previous_); }
  ResourceLimit(const ResourceLimit&) = delete;
  ResourceLimit& operator=(const ResourceLimit&) = delete;

 private:
  __rlimit_resource resource_;
  rlimit previous_{};
};

// Bytes of addresses that this process has.
inline rlim_t AddressesInUse() {
  rlim_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<rlim_t>(getpagesize());
}

}  // namespace b4mrl

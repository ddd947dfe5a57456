#include "server/sandbox/sandbox.h"

#include <fcntl.h>
#include <linux/landlock.h>
#include <spdlog/spdlog.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>

#include "proto/base/unique_fd.h"

namespace b4mrl {
namespace {

// Parts of version 4 of Landlock's interface, which linux/landlock.h of Debian 12 lacks.
struct RulesetAttributes {
  uint64_t handled_access_fs;
  uint64_t handled_access_net;
};
constexpr uint64_t kAllNetworkAccess = 3;  // bind and connect over TCP
constexpr uint64_t kTruncate = 1ull << 14;
constexpr uint64_t kVersion1Access = (1ull << 13) - 1;

constexpr uint64_t kFolderAccess = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR |
                                   LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_MAKE_REG |
                                   LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_REMOVE_FILE |
                                   LANDLOCK_ACCESS_FS_REMOVE_DIR;

// Sets the soft limit to `value` and the hard limit `slack` above it, as the kernel sends another
// signal at each of the two.
Status SetLimit(int resource, uint64_t value, const char* name, uint64_t slack = 0) {
  const auto which = static_cast<__rlimit_resource>(resource);
  rlimit limit{};
  if (getrlimit(which, &limit) == 0) {
    // Only a privileged process may raise its hard limit, so a lower one is kept.
    limit.rlim_max = std::min<rlim_t>(limit.rlim_max, value + slack);
    limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, value);
    if (setrlimit(which, &limit) == 0) return Status();
  }
  return Status(StatusCode::kInternal,
                std::string("cannot limit ") + name + ": " + std::strerror(errno));
}

Status Allow(int ruleset, const std::string& path, uint64_t access) {
  const UniqueFd parent(open(path.c_str(), O_PATH | O_CLOEXEC));
  if (!parent.valid()) return IoError("open", path, errno);
  landlock_path_beneath_attr rule{};
  rule.allowed_access = access;
  rule.parent_fd = parent.get();
  if (syscall(SYS_landlock_add_rule, ruleset, LANDLOCK_RULE_PATH_BENEATH, &rule, 0) != 0) {
    return IoError("confine access to", path, errno);
  }
  return Status();
}

Status ConfineFiles(const SandboxOptions& options) {
  const long version =  // NOLINT: the kernel's type
      syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION);
  if (version < 1) {
    spdlog::warn("no Landlock in this kernel: file access is not confined");
    return Status();
  }
  const uint64_t truncate = version >= 3 ? kTruncate : 0;
  RulesetAttributes attributes{kVersion1Access | truncate, kAllNetworkAccess};
  const size_t size = version >= 4 ? sizeof(attributes) : sizeof(attributes.handled_access_fs);
  const UniqueFd ruleset(
      static_cast<int>(syscall(SYS_landlock_create_ruleset, &attributes, size, 0)));
  if (!ruleset.valid()) {
    return Status(StatusCode::kInternal,
                  std::string("cannot make a Landlock ruleset: ") + std::strerror(errno));
  }
  for (const std::string& path : options.readable_paths) {
    B4MRL_RETURN_IF_ERROR(Allow(ruleset.get(), path, LANDLOCK_ACCESS_FS_READ_FILE));
  }
  B4MRL_RETURN_IF_ERROR(Allow(ruleset.get(), options.writable_folder, kFolderAccess | truncate));
  if (syscall(SYS_landlock_restrict_self, ruleset.get(), 0) != 0) {
    return Status(StatusCode::kInternal,
                  std::string("cannot enter the Landlock ruleset: ") + std::strerror(errno));
  }
  return Status();
}

}  // namespace

Status EnterSandbox(const SandboxOptions& options) {
  // A write beyond the limit on file sizes is to fail instead of ending the process.
  std::signal(SIGXFSZ, SIG_IGN);
  B4MRL_RETURN_IF_ERROR(SetLimit(RLIMIT_CORE, 0, "core files"));
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  // No limit with sanitizers, which reserve terabytes of addresses for their shadow memory.
  B4MRL_RETURN_IF_ERROR(SetLimit(RLIMIT_AS, options.memory_bytes, "memory"));
#endif
  B4MRL_RETURN_IF_ERROR(SetLimit(RLIMIT_CPU, options.cpu_seconds, "processor time", 1));
  B4MRL_RETURN_IF_ERROR(SetLimit(RLIMIT_FSIZE, options.file_bytes, "file sizes"));
  B4MRL_RETURN_IF_ERROR(SetLimit(RLIMIT_NOFILE, options.descriptors, "descriptors"));
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  // A process that outlived this one could change files after they were checked. Sanitizers start
  // threads of their own.
  if (options.alone) B4MRL_RETURN_IF_ERROR(SetLimit(RLIMIT_NPROC, 0, "processes"));
#endif
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
    return Status(StatusCode::kInternal, "cannot give up new privileges");
  }
  return ConfineFiles(options);
}

}  // namespace b4mrl

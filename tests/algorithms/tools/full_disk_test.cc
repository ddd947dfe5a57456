// A file system without room: nothing half-written stays, the message says so, the daemon goes on.
#include <fcntl.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "client/client.h"
#include "client/private_daemon.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// Lets a user without privileges mount, where the kernel allows that.
bool BecomeRootOfNamespace() {
  const std::string user = "0 " + std::to_string(getuid()) + " 1";
  const std::string group = "0 " + std::to_string(getgid()) + " 1";
  if (unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) return false;
  std::ofstream("/proc/self/setgroups") << "deny";
  std::ofstream("/proc/self/uid_map") << user;
  std::ofstream("/proc/self/gid_map") << group;
  return true;
}

// A file system of `bytes` in memory, seen by this process and those it starts. Mounting wants
// root, or a kernel that lets users have namespaces of their own.
class SmallDisk {
 public:
  explicit SmallDisk(size_t bytes) {
    static const bool separate = unshare(CLONE_NEWNS) == 0 || BecomeRootOfNamespace();
    if (!separate) return;
    mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr);
    const std::string options = "size=" + std::to_string(bytes);
    mounted_ = mount("tmpfs", folder_.path().c_str(), "tmpfs", 0, options.c_str()) == 0;
  }
  ~SmallDisk() {
    if (mounted_) umount2(folder_.path().c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  bool mounted() const { return mounted_; }
  const std::string& path() const { return folder_.path(); }
  size_t free_bytes() const {
    struct statvfs info {};
    REQUIRE(statvfs(path().c_str(), &info) == 0);
    return info.f_bavail * info.f_frsize;
  }
  // Leaves `bytes` of room.
  void FillUpTo(size_t bytes) {
    const std::string block(4096, 'x');
    std::ofstream file(path() + "/ballast", std::ios::binary);
    while (free_bytes() > bytes) REQUIRE(file.write(block.data(), 4096).flush());
  }

 private:
  TemporaryFolder folder_;
  bool mounted_ = false;
};

// Files under `folder`, by name, whatever their depth.
Words FilesUnder(const std::string& folder) {
  Words files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files.push_back(entry.path().filename());
  }
  return files;
}

bool Skipped(const SmallDisk& disk) {
  if (!disk.mounted()) WARN("SKIPPED: file systems cannot be mounted here");
  return !disk.mounted();
}

TEST_CASE("A dataset that does not fit on the disk ends with code 3 and leaves nothing behind") {
  const SmallDisk disk(1 << 20);
  if (Skipped(disk)) return;
  const Outcome made = Run({"dataset", "make", "HalfCheetah/medium", "--rows", "20000", "--quiet",
                            "--data", disk.path()});
  INFO(made.err);
  CHECK(made.exit_code == 3);
  CHECK(made.err.find("No space left on device") != std::string::npos);
  CHECK(FilesUnder(disk.path()).empty());
  CHECK_FALSE(fs::exists(disk.path() + "/HalfCheetah"));
}

TEST_CASE("A dataset whose columns find no room is refused, and the daemon goes on serving") {
  SmallDisk disk(16 << 20);
  if (Skipped(disk)) return;
  REQUIRE(Run({"dataset", "make", "HalfCheetah/medium", "--rows", "5000", "--quiet", "--data",
               disk.path()})
              .exit_code == 0);

  PrivateDaemonOptions options;
  options.binary = B4MRL_BINARY_DIR "/b4mrl-serve";
  options.data_folder = disk.path();
  // Columns that an earlier daemon left would need no room.
  fs::remove_all(disk.path() + "/.b4mrl-cache");
  disk.FillUpTo(64 << 10);
  Result<PrivateDaemon> daemon = PrivateDaemon::Start(options);
  REQUIRE(daemon.ok());
  Result<Client> client = Client::Connect(daemon->endpoint());
  REQUIRE(client.ok());
  const Status refused = client->OpenDataset("HalfCheetah/medium").status();
  INFO(refused.ToString());
  CHECK_FALSE(refused.ok());
  CHECK(refused.message().find("No space left on device") != std::string::npos);

  fs::remove(disk.path() + "/ballast");
  CHECK(client->OpenDataset("HalfCheetah/medium").ok());
}

}  // namespace
}  // namespace b4mrl

#include "data/files/cache_root.h"

#include <sys/stat.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/data/temporary_folder.h"
#include "tests/environment_variable.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// A user whose cache is in a folder of its own, as long as it lives.
class User {
 public:
  std::string File(const std::string& name) const { return folder_.File(name); }

 private:
  TemporaryFolder folder_;
  const EnvironmentVariable cache_{"XDG_CACHE_HOME", folder_.File("cache")};
};

mode_t ModeOf(const std::string& path) {
  struct stat info {};
  REQUIRE(stat(path.c_str(), &info) == 0);
  return info.st_mode & 07777;
}

TEST_CASE("Caches are in the data folder, for its user alone") {
  const User user;
  fs::create_directory(user.File("data"));
  REQUIRE(CacheRoot(user.File("data")) == user.File("data/.b4mrl-cache"));
  REQUIRE(MakeCacheRoot(user.File("data")).ok());
  CHECK(ModeOf(user.File("data/.b4mrl-cache")) == 0700);
  CHECK_FALSE(fs::exists(user.File("cache")));
}

TEST_CASE("Caches of a data folder to which nothing can be written are in the user's cache") {
  const User user;
  // A path through a file, because root may write to every folder.
  std::ofstream(user.File("file")) << "no folder";
  const std::string data = user.File("file/data"), root = CacheRoot(data);
  REQUIRE(root.starts_with(user.File("cache/b4mrl/data-")));
  CHECK(CacheRoot(user.File("cache/../file/data")) == root);
  CHECK(CacheRoot(user.File("file/other")) != root);
  REQUIRE(MakeCacheRoot(data).ok());
  CHECK(ModeOf(root) == 0700);
  CHECK_FALSE(fs::exists(data));
  REQUIRE(MakeFolderInside(root + "/index").ok());
  CHECK(ModeOf(root + "/index") == 0700);
}

TEST_CASE("Caches of a data folder that is still to be made will be in it") {
  const User user;
  const std::string data = user.File("not/yet");
  REQUIRE(CacheRoot(data) == data + "/.b4mrl-cache");
  REQUIRE(MakeCacheRoot(data).ok());
  CHECK(fs::is_directory(data + "/.b4mrl-cache"));
  CHECK(CacheRoot(data) == data + "/.b4mrl-cache");

  const fs::path before = fs::current_path();
  fs::current_path(data);
  CHECK(CacheRoot("here") == "here/.b4mrl-cache");
  fs::current_path(before);
  CHECK_FALSE(fs::exists(user.File("cache")));
}

TEST_CASE("A data folder or a cache of somebody else's is not written to") {
  if (geteuid() == 0) {
    WARN("skipped: root may write to every folder");
    return;
  }
  const User user;
  const std::string data = user.File("data");
  fs::create_directories(data + "/.b4mrl-cache");
  chmod((data + "/.b4mrl-cache").c_str(), 0500);
  CHECK(CacheRoot(data).starts_with(user.File("cache/b4mrl/data-")));
  chmod((data + "/.b4mrl-cache").c_str(), 0700);
  chmod(data.c_str(), 0500);
  CHECK(CacheRoot(data) == data + "/.b4mrl-cache");
  fs::permissions(data, fs::perms::owner_all);
  fs::remove(data + "/.b4mrl-cache");
  chmod(data.c_str(), 0500);
  CHECK(CacheRoot(data).starts_with(user.File("cache/b4mrl/data-")));
  chmod(data.c_str(), 0700);
}

}  // namespace
}  // namespace b4mrl

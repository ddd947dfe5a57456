#include "proto/base/folders.h"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <string>

#include "proto/base/child_program.h"
#include "tests/data/temporary_folder.h"
#include "tests/environment_variable.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

std::string DataFolderWith(const char* own, const char* xdg, const char* home) {
  const EnvironmentVariable first("B4MRL_DATA", own);
  const EnvironmentVariable second("XDG_DATA_HOME", xdg);
  const EnvironmentVariable third("HOME", home);
  return DefaultDataFolder();
}

TEST_CASE("The data folder is B4MRL_DATA, else below XDG_DATA_HOME, else below HOME") {
  CHECK(DataFolderWith("/own", "/xdg", "/user") == "/own");
  CHECK(DataFolderWith(nullptr, "/xdg", "/user") == "/xdg/b4mrl");
  CHECK(DataFolderWith(nullptr, nullptr, "/user") == "/user/.local/share/b4mrl");
  CHECK(DataFolderWith(nullptr, nullptr, nullptr) == "/var/lib/.local/share/b4mrl");
}

TEST_CASE("Empty variables and relative folders of XDG or HOME say nothing") {
  CHECK(DataFolderWith("", "", "/user") == "/user/.local/share/b4mrl");
  CHECK(DataFolderWith(nullptr, "data", "/user") == "/user/.local/share/b4mrl");
  CHECK(DataFolderWith(nullptr, nullptr, "user") == "/var/lib/.local/share/b4mrl");
}

TEST_CASE("Shared files are the source tree's unless the program was installed with them") {
  const std::string name = "folders-test-of-" + std::to_string(getpid());
  CHECK(SharedFolder(name, "/sources") == "/sources");
  const fs::path lib = fs::path(ProgramBesideThisOne("")).parent_path().parent_path() / "lib";
  const bool had_lib = fs::exists(lib);
  fs::create_directories(lib / "b4mrl" / name);
  const std::string found = SharedFolder(name, "/sources");
  fs::remove(lib / "b4mrl" / name);
  if (!had_lib) fs::remove_all(lib);
  CHECK(found == lib / "b4mrl" / name);
}

TEST_CASE("A folder has one identity by whatever path, and no other folder has it") {
  const TemporaryFolder folder;
  fs::create_directory(folder.File("a"));
  fs::create_directory(folder.File("b"));
  fs::create_directory_symlink(folder.File("a"), folder.File("link"));
  std::ofstream(folder.File("file")) << "no folder";
  const uint64_t a = FolderIdentity(folder.File("a"));
  CHECK(a != 0);
  CHECK(FolderIdentity(folder.File("link")) == a);
  CHECK(FolderIdentity(folder.File("b") + "/../a/") == a);
  CHECK(FolderIdentity(folder.File("b")) != a);
  CHECK(FolderIdentity(folder.File("b")) != 0);
  CHECK(FolderIdentity(folder.File("none")) == 0);
  CHECK(FolderIdentity(folder.File("file")) == 0);
}

}  // namespace
}  // namespace b4mrl

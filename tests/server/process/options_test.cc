// The command line and configuration file of `b4mrl-serve`. bad_input_test has what they refuse.
#include "server/process/options.h"

#include <array>
#include <catch2/catch.hpp>
#include <filesystem>

#include "proto/base/child_program.h"
#include "tests/data/temporary_folder.h"
#include "tests/environment_variable.h"

namespace b4mrl {
namespace {

// `words` begin with the program's name.
CommandLine ParseWhole(std::vector<std::string> words) {
  std::vector<char*> argv = PointersTo(words);
  int exit_code = 0;
  const std::optional<CommandLine> line =
      ParseCommandLine(static_cast<int>(words.size()), argv.data(), &exit_code);
  REQUIRE(line);
  return *line;
}

ServeOptions Parse(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "b4mrl-serve");
  return ParseWhole(std::move(arguments)).serve;
}

// A folder with the folders that options name.
struct Folders {
  TemporaryFolder folder;
  std::string file = folder.File("serve.toml");

  Folders() {
    for (const char* name : {"data", "models", "suites", "other"}) {
      std::filesystem::create_directory(folder.File(name));
    }
  }
  ServeOptions ParseFile(const std::string& text, std::vector<std::string> arguments = {}) const {
    WriteBytes(file, text);
    arguments.insert(arguments.end(), {"--config", file});
    return Parse(std::move(arguments));
  }
  std::string Quoted(const char* name) const { return "'" + folder.File(name) + "'\n"; }
};

TEST_CASE("Every key of a configuration file sets its own option") {
  const Folders folders;
  const ServeOptions options = folders.ParseFile(
      "bind = ['tcp://127.0.0.1:1', 'ipc:///tmp/2']\nworkers = 3\nthreads = 4\nlease = 5\n"
      "memory = 66\ncache = 8\nspin = 7\ndata = " +
      folders.Quoted("data") + "models = " + folders.Quoted("models") +
      "suites = " + folders.Quoted("suites"));
  CHECK(options.binds == std::vector<std::string>{"tcp://127.0.0.1:1", "ipc:///tmp/2"});
  CHECK(options.workers == 3);
  CHECK(options.threads == 4);
  CHECK(options.lease_seconds == 5);
  CHECK(options.memory_mib == 66);
  CHECK(options.cache_mib == 8);
  CHECK(options.spin_us == 7u);
  CHECK(options.data_folder == folders.folder.File("data"));
  CHECK(options.models_folder == folders.folder.File("models"));
  CHECK(options.suites_folder == folders.folder.File("suites"));
}

TEST_CASE("Every switch of a configuration file sets its own option alone") {
  const Folders folders;
  const std::string data = "data = " + folders.Quoted("data");
  const auto switches = [&](const std::string& text) {
    const ServeOptions options = folders.ParseFile(data + text);
    return std::array{options.insecure, options.pin, options.single_port, options.no_door};
  };
  CHECK(switches("") == std::array{false, false, false, false});
  CHECK(switches("insecure = true\n") == std::array{true, false, false, false});
  CHECK(switches("pin = true\n") == std::array{false, true, false, false});
  CHECK(switches("single-port = true\n") == std::array{false, false, true, false});
  CHECK(switches("no-door = true\n") == std::array{false, false, false, true});
  CHECK(switches("no-door = false\n") == std::array{false, false, false, false});
}

TEST_CASE("A switch of the command line wins over that of the file, on or off") {
  const Folders folders;
  const ServeOptions options =
      folders.ParseFile("data = " + folders.Quoted("data") +
                            "insecure = true\npin = true\nsingle-port = true\nno-door = false\n",
                        {"--insecure=false", "--pin=false", "--single-port=false", "--no-door"});
  CHECK_FALSE(options.insecure);
  CHECK_FALSE(options.pin);
  CHECK_FALSE(options.single_port);
  CHECK(options.no_door);
}

TEST_CASE("A flag wins over the key of the configuration file") {
  const Folders folders;
  const ServeOptions options = folders.ParseFile(
      "bind = 'tcp://127.0.0.1:1'\nworkers = 3\nthreads = 4\nlease = 5\nmemory = 66\n"
      "cache = 8\nspin = 7\ndata = 'none'\nmodels = 'none'\nsuites = 'none'\n",
      {"--bind",    "tcp://127.0.0.1:2",
       "--workers", "13",
       "--threads", "14",
       "--lease",   "15",
       "--memory",  "76",
       "--cache",   "18",
       "--spin",    "0",
       "--data",    folders.folder.File("data"),
       "--models",  folders.folder.File("models"),
       "--suites",  folders.folder.File("other")});
  CHECK(options.binds == std::vector<std::string>{"tcp://127.0.0.1:2"});
  CHECK(options.workers == 13);
  CHECK(options.threads == 14);
  CHECK(options.lease_seconds == 15);
  CHECK(options.memory_mib == 76);
  CHECK(options.cache_mib == 18);
  CHECK(options.spin_us == 0u);
  CHECK(options.data_folder == folders.folder.File("data"));
  CHECK(options.models_folder == folders.folder.File("models"));
  CHECK(options.suites_folder == folders.folder.File("other"));
}

TEST_CASE("A child reads from its arguments what the supervisor tells it") {
  ChildOptions told;
  told.role = "worker";
  told.index = 1;
  told.threads = 3;
  told.pin = true;
  told.memory_mib = 66;
  told.cache_mib = 8;
  told.spin_us = 0;
  told.data_folder = "data";
  told.models_folder = "models";
  told.suites_folder = "suites";
  told.door_listener = 9;
  const CommandLine line = ParseWhole(ChildArguments(told, 5));
  CHECK(line.is_child);
  CHECK(line.shared_memory_fd == 5);
  CHECK(line.child.role == "worker");
  CHECK(line.child.index == 1);
  CHECK(line.child.threads == 3);
  CHECK(line.child.pin);
  CHECK(line.child.memory_mib == 66);
  CHECK(line.child.cache_mib == 8);
  CHECK(line.child.spin_us == 0u);
  CHECK(line.child.data_folder == "data");
  CHECK(line.child.models_folder == "models");
  CHECK(line.child.suites_folder == "suites");
  CHECK(line.child.door_listener == 9);
}

TEST_CASE("A daemon begins where its default data folder cannot be made") {
  const Folders folders;
  WriteBytes(folders.folder.File("no-folder"), "");
  const std::string none = folders.folder.File("no-folder/data");
  const EnvironmentVariable first("B4MRL_DATA", none);
  CHECK(Parse({}).data_folder == none);
  const std::string made = folders.folder.File("new/data");
  const EnvironmentVariable second("B4MRL_DATA", made);
  CHECK(Parse({}).data_folder == made);
  CHECK(std::filesystem::is_directory(made));
}

}  // namespace
}  // namespace b4mrl

// `b4mrl` as a child process with its outputs in pipes. For tests; one thread.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/base/child_program.h"
#include "proto/base/clock.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

using Words = std::vector<std::string>;

struct Outcome {
  int exit_code = -1;
  std::string out, err;
};

// What stands for the user's own data and caches, for all tools of a test program.
inline const std::string& UsersFolder() {
  static const TemporaryFolder folder;
  static const bool made = std::filesystem::create_directories(folder.File("data"));
  REQUIRE(made);
  return folder.path();
}

// What tells the programs where the user's own daemon, data and programs are.
inline Words UsersVariables() {
  Words names;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string text = *entry;
    if (text.starts_with("B4MRL_")) names.push_back(text.substr(0, text.find('=')));
  }
  return names;
}

// A running b4mrl-tools with both outputs in pipes.
class Tool {
 public:
  // `at_interrupt`: what SIGINT does when the program begins; a test that runs in the background
  // would inherit an ignored one.
  explicit Tool(const Words& arguments, const Words& environment = {},
                void (*at_interrupt)(int) = SIG_DFL) {
    std::array<int, 2> out{}, err{};
    REQUIRE(pipe2(out.data(), O_CLOEXEC) == 0);
    REQUIRE(pipe2(err.data(), O_CLOEXEC) == 0);
    const std::string data = UsersFolder() + "/data", cache = UsersFolder() + "/cache";
    process_id_ = fork();
    REQUIRE(process_id_ >= 0);
    if (process_id_ == 0) {
      for (const std::string& name : UsersVariables()) unsetenv(name.c_str());
      std::signal(SIGINT, at_interrupt);
      setenv("B4MRL_DATA", data.c_str(), 1);
      setenv("XDG_CACHE_HOME", cache.c_str(), 1);
      dup2(out[1], STDOUT_FILENO);
      dup2(err[1], STDERR_FILENO);
      for (const std::string& entry : environment) putenv(const_cast<char*>(entry.c_str()));
      Words words = {B4MRL_BINARY_DIR "/b4mrl"};
      words.insert(words.end(), arguments.begin(), arguments.end());
      std::vector<char*> argv;
      for (std::string& word : words) argv.push_back(word.data());
      argv.push_back(nullptr);
      execv(argv[0], argv.data());
      _exit(99);
    }
    close(out[1]);
    close(err[1]);
    out_ = out[0];
    err_ = err[0];
  }
  ~Tool() {
    if (process_id_ > 0) Kill();
    close(out_);
    close(err_);
  }

  // Reads stderr up to and including the first line with `text`; false at its end, or when nothing
  // comes for a minute.
  bool WaitForMessage(const std::string& text) {
    constexpr int kPatienceMs = 60'000;
    pollfd waiting{err_, POLLIN, 0};
    char c = 0;
    std::string line;
    while (poll(&waiting, 1, kPatienceMs) == 1 && read(err_, &c, 1) == 1) {
      line += c;
      if (c != '\n') continue;
      if (line.find(text) != std::string::npos) return true;
      line.clear();
    }
    return false;
  }
  // Whether it catches SIGINT by now; false if it ends or a minute passes before.
  bool WaitUntilItCatchesInterrupts() {
    for (const Deadline deadline = Deadline::AfterMs(60'000); !deadline.expired(); sched_yield()) {
      std::ifstream status("/proc/" + std::to_string(process_id_) + "/status");
      bool is_started = false;  // before, it is a copy of this process with this one's handlers
      for (std::string line; std::getline(status, line);) {
        is_started = is_started || line == "Name:\tb4mrl-tools";
        if (!is_started || !line.starts_with("SigCgt:")) continue;
        const uint64_t caught = std::strtoull(line.c_str() + 7, nullptr, 16);
        if ((caught >> (SIGINT - 1)) % 2 == 1) return true;
      }
    }
    return false;
  }
  void Signal(int number) { kill(process_id_, number); }
  void Kill() {
    kill(process_id_, SIGKILL);
    waitpid(std::exchange(process_id_, -1), nullptr, 0);
  }
  // Its outputs and its exit code; it fails the test if it has not ended after five minutes.
  Outcome Wait() {
    const Deadline deadline = Deadline::AfterMs(300'000);
    Outcome outcome;
    const std::array<std::string*, 2> texts = {&outcome.out, &outcome.err};
    std::array<pollfd, 2> streams = {{{out_, POLLIN, 0}, {err_, POLLIN, 0}}};  // until their ends
    while (std::ranges::any_of(streams, [](const pollfd& each) { return each.fd >= 0; })) {
      poll(streams.data(), streams.size(), static_cast<int>(deadline.remaining_ms()));
      if (deadline.expired()) {
        Kill();
        FAIL("a tool did not end: " << outcome.out << outcome.err);
      }
      for (size_t i = 0; i < streams.size(); ++i) {
        if (streams[i].revents != 0 && !ReadSome(streams[i].fd, texts[i])) streams[i].fd = -1;
      }
    }
    const int status = WaitForExit(std::exchange(process_id_, -1), deadline);
    outcome.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return outcome;
  }

 private:
  // False at the end.
  static bool ReadSome(int fd, std::string* text) {
    std::array<char, 4096> block{};
    const ssize_t n = read(fd, block.data(), block.size());
    if (n > 0) text->append(block.data(), static_cast<size_t>(n));
    return n > 0;
  }

  pid_t process_id_ = -1;
  int out_ = -1;
  int err_ = -1;
};

inline bool Says(const std::string& text, std::string_view words) {
  return text.find(words) != std::string::npos;
}

// How often it does.
inline size_t Count(const std::string& text, std::string_view words) {
  size_t count = 0;
  for (size_t at = 0; (at = text.find(words, at)) != std::string::npos; ++at) ++count;
  return count;
}

inline Outcome Run(const Words& arguments, const Words& environment = {}) {
  return Tool(arguments, environment).Wait();
}

}  // namespace b4mrl

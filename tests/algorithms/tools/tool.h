// `b4mrl` as a child process with its outputs in pipes. For tests; one thread.
#pragma once

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <csignal>
#include <cstdlib>
#include <string>
#include <vector>

namespace b4mrl {

using Words = std::vector<std::string>;

struct Outcome {
  int exit_code = -1;
  std::string out, err;
};

// A running b4mrl-tools with both outputs in pipes.
class Tool {
 public:
  explicit Tool(const Words& arguments, const Words& environment = {}) {
    std::array<int, 2> out{}, err{};
    REQUIRE(pipe2(out.data(), O_CLOEXEC) == 0);
    REQUIRE(pipe2(err.data(), O_CLOEXEC) == 0);
    process_id_ = fork();
    REQUIRE(process_id_ >= 0);
    if (process_id_ == 0) {
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
    close(out_);
    close(err_);
  }

  // Reads stderr up to and including the first line with `text`; false at its end.
  bool WaitForMessage(const std::string& text) {
    char c = 0;
    std::string line;
    while (read(err_, &c, 1) == 1) {
      line += c;
      if (c != '\n') continue;
      if (line.find(text) != std::string::npos) return true;
      line.clear();
    }
    return false;
  }
  void Kill() {
    kill(process_id_, SIGKILL);
    waitpid(process_id_, nullptr, 0);
  }
  Outcome Wait() {
    Outcome outcome;
    outcome.out = ReadAll(out_);  // short enough for both to fit their pipes
    outcome.err = ReadAll(err_);
    int status = 0;
    waitpid(process_id_, &status, 0);
    outcome.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return outcome;
  }

 private:
  static std::string ReadAll(int fd) {
    std::string text;
    std::array<char, 4096> block{};
    for (ssize_t n = 0; (n = read(fd, block.data(), block.size())) > 0;) {
      text.append(block.data(), static_cast<size_t>(n));
    }
    return text;
  }

  pid_t process_id_ = -1;
  int out_ = -1;
  int err_ = -1;
};

inline Outcome Run(const Words& arguments, const Words& environment = {}) {
  return Tool(arguments, environment).Wait();
}

}  // namespace b4mrl

#include "proto/command_line/shell_word.h"

#include <array>
#include <catch2/catch.hpp>
#include <cstdio>

namespace b4mrl {
namespace {

// What the shell makes of a command line's only argument.
std::string ReadBack(const std::string& word) {
  FILE* shell = popen(("printf %s " + ShellWord(word)).c_str(), "r");
  REQUIRE(shell != nullptr);
  std::string text;
  std::array<char, 100> block{};
  while (const size_t count = fread(block.data(), 1, block.size(), shell)) {
    text.append(block.data(), count);
  }
  CHECK(pclose(shell) == 0);
  return text;
}

TEST_CASE("A shell reads a word back as it was, and plain words stay as they are") {
  for (const char* plain : {"HalfCheetah/medium-v0", "hidden=9+16,obs-noise=0.05", "a_b@c:1"}) {
    CHECK(ShellWord(plain) == plain);
    CHECK(ReadBack(plain) == plain);
  }
  for (const char* other : {"", "my agent.h5", "it's", "'", "$HOME", "`ls`", "a\\b", "*", "~", "#",
                            "two\nlines", "\"", ";|&<>()"}) {
    INFO(other);
    CHECK(ShellWord(other) != other);
    CHECK(ReadBack(other) == other);
  }
}

}  // namespace
}  // namespace b4mrl

// What keeps the sources readable: sizes, randomness from one place, nothing that names one
// machine.
#include <catch2/catch.hpp>
#include <regex>

#include "tests/architecture/source_tree.h"

namespace b4mrl {
namespace {

constexpr size_t kMaxFileLines = 400;
constexpr size_t kMaxFunctionLines = 70;
constexpr size_t kMaxColumns = 100;

struct Forbidden {
  std::string what;
  std::regex pattern;
};

void CheckAbsent(const std::vector<SourceFile>& files, const std::vector<Forbidden>& words) {
  for (const SourceFile& file : files) {
    if (file.EndsWith("architecture/style_test.cc")) continue;  // it spells them out
    for (size_t i = 0; i < file.lines.size(); ++i) {
      for (const Forbidden& word : words) {
        if (!std::regex_search(file.lines[i], word.pattern)) continue;
        FAIL_CHECK(file.path << ":" << i + 1 << " has " << word.what << ": " << file.lines[i]);
      }
    }
  }
}

// Blocks that open behind a parenthesis, as bodies of functions do; loops and conditions are blocks
// too, but shorter than the function around them. First and last line, 1-based.
std::vector<std::pair<size_t, size_t>> Bodies(const SourceFile& file) {
  static const std::regex kOpens(R"(.*\)( const| noexcept| override| final| ->.*)* \{$)");
  struct Block {
    size_t line;
    bool is_body;
  };
  std::vector<Block> open;
  std::vector<std::pair<size_t, size_t>> bodies;
  for (size_t i = 0; i < file.lines.size(); ++i) {
    const std::string code = (" " + file.lines[i]).substr(0, (" " + file.lines[i]).find(" //"));
    for (const char c : code) {
      if (c == '{') open.push_back({i + 1, false});
      if (c != '}' || open.empty()) continue;
      if (open.back().is_body) bodies.emplace_back(open.back().line, i + 1);
      open.pop_back();
    }
    if (!open.empty() && std::regex_match(file.lines[i], kOpens)) open.back().is_body = true;
  }
  return bodies;
}

TEST_CASE("Source files stay short") {
  for (const SourceFile& file : ReadTree({".h", ".cc", ".py"})) {
    INFO(file.path);
    CHECK(file.lines.size() <= kMaxFileLines);
  }
}

TEST_CASE("Functions stay short") {
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    if (file.folder == "tests") continue;
    for (const auto& [first, last] : Bodies(file)) {
      INFO(file.path << ":" << first << " to " << last);
      CHECK(last - first + 1 <= kMaxFunctionLines);
    }
  }
}

TEST_CASE("Lines fit their column limit") {
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    for (size_t i = 0; i < file.lines.size(); ++i) {
      // UTF-8 continuation bytes take no column.
      size_t columns = 0;
      for (const char c : file.lines[i]) columns += (static_cast<unsigned char>(c) & 0xC0) != 0x80;
      INFO(file.path << ":" << i + 1);
      CHECK((columns <= kMaxColumns || file.lines[i].find("http") != std::string::npos));
    }
  }
}

TEST_CASE("Random numbers come from proto/base/rng.h") {
  std::vector<SourceFile> files;
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    if (file.folder != "tests") files.push_back(file);
  }
  CheckAbsent(files, {{"the standard library's generators", std::regex("#include <random>")},
                      {"the C library's generator", std::regex(R"(\b(rand|drand48)\s*\()")},
                      {"the C library's generator", std::regex(R"(\brandom\(\))")}});
}

TEST_CASE("Sources name no machine, home folder or open end") {
  CheckAbsent(ReadTree({".h", ".cc", ".txt", ".cmake", ".proto", ".md", ".toml", ".py", ".rb",
                        ".sh", "/run", "/make", ".command", "run_tests", "quickstart",
                        "order_of_runs", "install_packages"}),
              {{"a home folder", std::regex(R"((/home/|/root/|/Users/)\w)")},
               {"a working folder", std::regex(R"((^|[\s"'(=])/work/)")},
               {"an open end", std::regex(R"(\b(TODO|FIXME|XXX|TEMPORARY)\b)")}});
}

TEST_CASE("Nothing sleeps for a fixed time in a test") {
  std::vector<SourceFile> files;
  for (const SourceFile& file : ReadTree({".h", ".cc", ".py"})) {
    if (file.folder == "tests") files.push_back(file);
  }
  CheckAbsent(files, {{"a sleep", std::regex(R"(\b(sleep_for|sleep_until|usleep|nanosleep)\b)")},
                      {"a sleep", std::regex(R"(\bsleep\s*\()")}});
}

}  // namespace
}  // namespace b4mrl

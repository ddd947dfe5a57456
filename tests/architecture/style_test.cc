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

// A function's body is taken to run from a line that starts in column 0 and ends with "{" to the
// next "}" in column 0. Classes, namespaces and tables are told apart by their first word.
std::vector<std::pair<size_t, size_t>> TopLevelBodies(const SourceFile& file) {
  static const std::regex kNotAFunction(
      R"(^(namespace|class|struct|union|enum|extern|constexpr|const|static const|inline constexpr|\}|template <.*> (class|struct)).*)");
  std::vector<std::pair<size_t, size_t>> bodies;
  size_t start = 0;
  bool inside = false;
  for (size_t i = 0; i < file.lines.size(); ++i) {
    const std::string& line = file.lines[i];
    if (!inside && line.ends_with("{") && !line.empty() && !std::regex_match(line, kNotAFunction)) {
      inside = true;
      start = i;
    } else if (inside && line.starts_with("}")) {
      inside = false;
      bodies.emplace_back(start + 1, i + 1);
    }
  }
  return bodies;
}

TEST_CASE("Source files stay short") {
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    INFO(file.path);
    CHECK(file.lines.size() <= kMaxFileLines);
  }
}

TEST_CASE("Functions stay short") {
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    if (file.folder == "tests") continue;
    for (const auto& [first, last] : TopLevelBodies(file)) {
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
                      {"the C library's generator", std::regex(R"(\b(s?rand|drand48)\s*\()")},
                      {"the C library's generator", std::regex(R"(\brandom\(\))")}});
}

TEST_CASE("Sources name no machine, home folder or open end") {
  CheckAbsent(ReadTree({".h", ".cc", ".txt", ".proto", ".md", ".toml"}),
              {{"a home folder", std::regex(R"((/home/|/root/|/Users/)\w)")},
               {"a working folder", std::regex(R"((^|[\s"'(=])/work/)")},
               {"an open end", std::regex(R"(\b(TODO|FIXME|XXX|TEMPORARY)\b)")}});
}

TEST_CASE("Nothing sleeps for a fixed time in a test") {
  std::vector<SourceFile> files;
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    if (file.folder == "tests") files.push_back(file);
  }
  CheckAbsent(files, {{"a sleep", std::regex(R"(\b(sleep_for|usleep|nanosleep)\b)")}});
}

}  // namespace
}  // namespace b4mrl

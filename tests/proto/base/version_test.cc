#include "proto/base/version.h"

#include <catch2/catch.hpp>
#include <fstream>
#include <iterator>
#include <regex>
#include <string>

namespace b4mrl {
namespace {

// What `pattern` captures in a file of the repository; "" where it does not occur.
std::string Find(const std::string& path, const std::string& pattern) {
  std::ifstream file(B4MRL_SOURCE_DIR "/" + path);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  std::smatch match;
  return std::regex_search(text, match, std::regex(pattern)) ? match[1].str() : "";
}

TEST_CASE("The programs and the Python package have the version of CMakeLists.txt") {
  const std::string version = Find("CMakeLists.txt", R"(project\(b4mrl VERSION (\S+))");
  REQUIRE_FALSE(version.empty());
  CHECK(ProjectVersion() == version);
  CHECK(Find("client/python/b4mrl/version.py", R"re(__version__ = "([^"]+)")re") == version);
}

}  // namespace
}  // namespace b4mrl

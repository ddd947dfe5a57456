// Lists against files: what stands in a folder is built, and what is built can be named.
#include <catch2/catch.hpp>
#include <set>

#include "tests/architecture/source_tree.h"

namespace b4mrl {
namespace {

std::string FileName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

bool Mentions(const std::string& text, const std::string& name) {
  for (size_t at = text.find(name); at != std::string::npos; at = text.find(name, at + 1)) {
    const bool starts = at == 0 || std::string("/ \n\t(").find(text[at - 1]) != std::string::npos;
    const size_t end = at + name.size();
    const bool ends =
        end == text.size() || std::string(" \n\t)").find(text[end]) != std::string::npos;
    if (starts && ends) return true;
  }
  return false;
}

TEST_CASE("Every source file is named by a CMakeLists.txt of its folder or one above") {
  const std::vector<SourceFile> builds = ReadTree({"CMakeLists.txt"});
  for (const SourceFile& file : ReadTree({".cc"})) {
    bool built = false;
    for (const SourceFile& build : builds) {
      const std::string folder = build.path.substr(0, build.path.rfind('/') + 1);
      built = built || (file.In(folder) && Mentions(build.text(), FileName(file.path)));
    }
    INFO(file.path);
    CHECK(built);
  }
}

TEST_CASE("Every header has a reader") {
  std::set<std::string> included;
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    for (const Include& include : IncludesOf(file)) included.insert(include.path);
  }
  for (const SourceFile& file : ReadTree({".h"})) {
    INFO(file.path);
    CHECK(included.contains(file.path));
  }
}

}  // namespace
}  // namespace b4mrl

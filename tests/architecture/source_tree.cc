#include "tests/architecture/source_tree.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <fstream>
#include <regex>

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

const char* const kFolders[] = {"proto",      "data",       "server", "client",
                                "algorithms", "benchmarks", "tests",  "cmake"};

}  // namespace

std::string SourceFile::text() const {
  std::string all;
  for (const std::string& line : lines) all += line + "\n";
  return all;
}

SourceFile ReadSource(const std::string& path) {
  std::ifstream stream(fs::path(B4MRL_SOURCE_DIR) / path);
  INFO("reading " << path);
  REQUIRE(stream);
  SourceFile file{path, path.substr(0, path.find('/')), {}};
  for (std::string line; std::getline(stream, line);) file.lines.push_back(line);
  return file;
}

std::vector<std::string> SectionOf(const std::string& path, const std::string& heading) {
  const std::string level = heading.substr(0, heading.find(' ') + 1);
  std::vector<std::string> section;
  bool inside = false;
  for (const std::string& line : ReadSource(path).lines) {
    if (line.starts_with(level)) inside = line == heading;
    if (inside) section.push_back(line);
  }
  INFO("looking for " << heading << " in " << path);
  REQUIRE_FALSE(section.empty());
  return section;
}

std::vector<SourceFile> ReadTree(const std::vector<std::string>& suffixes) {
  std::vector<SourceFile> files;
  const fs::path root = B4MRL_SOURCE_DIR;
  const auto add = [&](const fs::directory_entry& entry) {
    const std::string path = fs::relative(entry.path(), root).generic_string();
    const bool wanted = std::any_of(suffixes.begin(), suffixes.end(),
                                    [&](const std::string& s) { return path.ends_with(s); });
    if (entry.is_regular_file() && wanted) files.push_back(ReadSource(path));
  };
  for (const auto& entry : fs::directory_iterator(root)) add(entry);
  for (const char* folder : kFolders) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) add(entry);
  }
  std::sort(files.begin(), files.end(),
            [](const SourceFile& a, const SourceFile& b) { return a.path < b.path; });
  return files;
}

std::vector<Include> IncludesOf(const SourceFile& file) {
  static const std::regex kInclude(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"].*)");
  std::vector<Include> includes;
  for (size_t i = 0; i < file.lines.size(); ++i) {
    std::smatch match;
    if (std::regex_match(file.lines[i], match, kInclude)) {
      includes.push_back({static_cast<int>(i + 1), match[2], match[1] == "\""});
    }
  }
  return includes;
}

}  // namespace b4mrl

// The checkout's own source files, read once, for tests of what they may contain.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace b4mrl {

struct SourceFile {
  std::string path;    // from the repository's root: "proto/base/rng.h"
  std::string folder;  // its first component
  std::vector<std::string> lines;

  bool EndsWith(std::string_view suffix) const { return path.ends_with(suffix); }
  bool In(std::string_view prefix) const { return path.starts_with(prefix); }
  std::string text() const;
};

// What the tree's folders of sources hold, sorted by path; `suffixes` such as ".h".
std::vector<SourceFile> ReadTree(const std::vector<std::string>& suffixes);
// One file; fails the running test when it is missing.
SourceFile ReadSource(const std::string& path);
// The lines of a Markdown file from `heading` to the next heading of the same level; fails the
// running test when there is no such heading.
std::vector<std::string> SectionOf(const std::string& path, const std::string& heading);

struct Include {
  int line;          // 1-based
  std::string path;  // as written, without quotes or brackets
  bool quoted;       // "..." rather than <...>
};
std::vector<Include> IncludesOf(const SourceFile& file);

}  // namespace b4mrl

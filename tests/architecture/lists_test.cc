// Lists against files: what stands in a folder is built, and what is built can be named.
#include <catch2/catch.hpp>
#include <cctype>
#include <filesystem>
#include <regex>
#include <set>

#include "tests/architecture/source_tree.h"

namespace b4mrl {
namespace {

std::string FileName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

// "half_cheetah" -> "HalfCheetah"
std::string CamelCase(const std::string& snake) {
  std::string camel;
  bool upper = true;
  for (const char c : snake) {
    if (c != '_') camel += upper ? static_cast<char>(std::toupper(c)) : c;
    upper = c == '_';
  }
  return camel;
}

// The files of a folder, without its subfolders, as "half_cheetah".
std::set<std::string> StemsIn(const std::string& folder, const std::string& suffix) {
  std::set<std::string> stems;
  for (const SourceFile& file : ReadTree({suffix})) {
    const std::string name = FileName(file.path);
    if (file.path == folder + "/" + name) stems.insert(name.substr(0, name.rfind('.')));
  }
  return stems;
}

std::set<std::string> MatchesIn(const std::string& text, const std::regex& pattern) {
  std::set<std::string> found;
  for (std::sregex_iterator it(text.begin(), text.end(), pattern), end; it != end; ++it) {
    found.insert((*it)[1]);
  }
  return found;
}

// The entries of a folder's list.cc against the files that define them, in that folder or in
// `more`: one file each, named after it. A file with neither an entry nor a header of its own is
// one that the list forgot.
void CheckEntries(const std::string& folder, const std::string& type,
                  const std::vector<std::string>& more = {}) {
  const std::string list = ReadSource(folder + "/list.cc").text();
  const std::set<std::string> listed = MatchesIn(list, std::regex(R"(ENTRY\(k(\w+)\))"));
  CHECK_FALSE(listed.empty());
  std::set<std::string> defined;
  std::vector<std::string> rooms = more;
  rooms.push_back(folder);
  for (const std::string& room : rooms) {
    const std::set<std::string> headers = StemsIn(room, ".h");
    for (const std::string& stem : StemsIn(room, ".cc")) {
      const std::string text = ReadSource(room + "/" + stem + ".cc").text();
      const std::set<std::string> entries =
          MatchesIn(text, std::regex("\nconstinit const " + type + R"( k(\w+) ?[={])"));
      INFO(room << "/" << stem << ".cc");
      CHECK((!entries.empty() || headers.contains(stem)));
      if (!entries.empty()) CHECK(entries == std::set<std::string>{CamelCase(stem)});
      defined.insert(entries.begin(), entries.end());
    }
  }
  CHECK(defined == listed);
}

TEST_CASE("Each environment is one file and one line of the list") {
  CheckEntries("server/environments", "EnvironmentEntry", {"server/environments/mujoco"});
}

TEST_CASE("Each environment of the list has its name in Gymnasium's registry") {
  const std::string list = ReadSource("server/environments/list.cc").text();
  const std::string registration = ReadSource("client/python/b4mrl/registration.py").text();
  std::smatch known;
  REQUIRE(std::regex_search(registration, known, std::regex(R"(_KNOWN = \(([^)]*)\))")));
  CHECK(MatchesIn(known[1], std::regex(R"re("(\w+)")re")) ==
        MatchesIn(list, std::regex(R"(ENTRY\(k(\w+)\))")));
}

TEST_CASE("Each perturbation is one file and one line of the list") {
  CheckEntries("server/perturbations", "PerturbationEntry");
}

TEST_CASE("Each learner is one file and one line of the list") {
  const std::string list = ReadSource("algorithms/list.cc").text();
  const std::set<std::string> listed = MatchesIn(list, std::regex(R"(\n  LINE\((\w+)\))"));
  std::set<std::string> files;
  const std::set<std::string> parts = StemsIn("algorithms/learners", ".h");  // of several learners
  for (const std::string& stem : StemsIn("algorithms/learners", ".cc")) {
    if (!parts.contains(stem)) files.insert(CamelCase(stem));
  }
  CHECK(files == listed);
}

std::string FolderOf(const std::string& path) { return path.substr(0, path.rfind('/')); }

// Adds the folders whose sources a CMakeLists.txt builds as a whole, by b4mrl_room_sources.
void AddRooms(const SourceFile& build, std::set<std::string>& folders) {
  const std::regex call(R"(b4mrl_room_sources\(\w+\s([^)]*)\))");
  for (const std::string& arguments : MatchesIn(build.text(), call)) {
    for (const std::string& folder : MatchesIn(arguments, std::regex(R"(([\w/.]+))"))) {
      folders.insert(FolderOf(build.path) + (folder == "." ? "" : "/" + folder));
    }
  }
}

// Adds the sources that a CMakeLists.txt builds by name, as paths from the repository's root.
// Comments and properties may name others.
void AddNames(const SourceFile& build, std::set<std::string>& names) {
  const std::regex builds_nothing(R"(#[^\n]*|set_source_files_properties\([^)]*\))");
  const std::regex root(R"(^\$\{(PROJECT|CMAKE)_SOURCE_DIR\}/)");
  const std::string text = std::regex_replace(build.text(), builds_nothing, "");
  for (const std::string& name : MatchesIn(text, std::regex(R"(([\w${}./-]+\.cc)\b)"))) {
    const std::string from_root = std::regex_replace(name, root, "");
    const std::filesystem::path base = from_root == name ? FolderOf(build.path) : "";
    names.insert((base / from_root).lexically_normal().generic_string());
  }
}

TEST_CASE("Every source file is built: by its folder or by its name") {
  std::set<std::string> folders;
  std::set<std::string> names;
  for (const SourceFile& build : ReadTree({"CMakeLists.txt"})) {
    AddRooms(build, folders);
    AddNames(build, names);
  }
  CHECK(folders.size() > 30);
  CHECK(names.size() > 30);
  for (const SourceFile& file : ReadTree({".cc"})) {
    INFO(file.path);
    CHECK((names.contains(file.path) || folders.contains(FolderOf(file.path))));
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

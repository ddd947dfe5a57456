// The arrows between folders, and which folder may include which third-party library.
#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <map>
#include <regex>
#include <set>
#include <sstream>

#include "tests/architecture/source_tree.h"

namespace b4mrl {
namespace {

using Arrows = std::map<std::string, std::set<std::string>>;

// ARCHITECTURE.md's table: room -> rooms that its files may include, beside itself and proto/.
Arrows AllowedArrows() {
  static const std::regex row(R"(^\| `([\w/]+)` \|.*\|([^|]*)\|$)");
  static const std::regex name(R"(`([\w/]+)`)");
  Arrows arrows;
  for (const std::string& line : SectionOf("ARCHITECTURE.md", "## Rooms and arrows")) {
    std::smatch parts;
    if (!std::regex_match(line, parts, row)) continue;
    std::set<std::string>& others = arrows[parts[1]];
    const std::string list = parts[2];
    for (std::sregex_iterator it(list.begin(), list.end(), name), end; it != end; ++it) {
      others.insert((*it)[1]);
    }
  }
  return arrows;
}

// ARCHITECTURE.md's picture: room -> number of its line, from the top.
std::map<std::string, size_t> Layers() {
  std::map<std::string, size_t> layers;
  size_t number = 0;
  bool inside = false;
  for (const std::string& line : SectionOf("ARCHITECTURE.md", "## Rooms and arrows")) {
    if (line == "```") {
      inside = !inside;
    } else if (inside) {
      std::istringstream words(line);
      for (std::string room; words >> room;) layers.emplace(room, number);
      ++number;
    }
  }
  return layers;
}

// tests and benchmarks/performance may see all.
bool SeesAll(const SourceFile& file) {
  return file.folder == "tests" || file.In("benchmarks/performance/");
}

std::string RoomOf(const std::string& path) { return path.substr(0, path.rfind('/')); }

struct Door {
  std::string library;
  std::vector<std::string> headers;   // prefixes of what stands between < and >, or quotes
  std::vector<std::string> prefixes;  // of the paths that may include them
};

const std::vector<Door> kDoors = {
    {"ZeroMQ", {"zmq"}, {"proto/wire/"}},
    {"HDF5", {"hdf5", "H5"}, {"data/"}},
    {"toml++", {"toml++/"}, {"data/files/toml_file"}},
    {"MuJoCo", {"mujoco/"}, {"server/environments/", "server/perturbations/", "server/render/"}},
    {"OSMesa", {"GL/"}, {"server/render/"}},
    {"Cairo", {"cairo"}, {"server/render/"}},
    {"TinyXML", {"tinyxml2"}, {"server/models/model_scan"}},
    {"Eigen", {"Eigen/"}, {"algorithms/"}},
    {"BLAS", {"cblas", "openblas", "lapacke"}, {"algorithms/"}},
    {"Catch2", {"catch2/"}, {"tests/"}},
    // The client library, and what it links of proto, is built without these.
    {"spdlog", {"spdlog/"}, {"server/"}},
    {"nlohmann", {"nlohmann/"}, {"server/", "data/", "algorithms/", "benchmarks/"}},
    {"CLI11", {"CLI/"}, {"proto/command_line/", "algorithms/tools/", "benchmarks/"}},
    {"OpenSSL", {"openssl/"}, {"data/files/"}},
    {"xxHash", {"xxhash"}, {"server/", "data/"}},
};

bool StartsWithAny(const std::string& text, const std::vector<std::string>& prefixes) {
  return std::any_of(prefixes.begin(), prefixes.end(),
                     [&](const std::string& prefix) { return text.starts_with(prefix); });
}

std::string At(const SourceFile& file, const Include& include) {
  return file.path + ":" + std::to_string(include.line) + " includes " + include.path;
}

TEST_CASE("Includes follow the arrows between rooms") {
  const Arrows allowed = AllowedArrows();
  Arrows used;
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    if (SeesAll(file)) continue;
    const std::string room = RoomOf(file.path);
    INFO(file.path << " stands in a room that ARCHITECTURE.md does not name");
    REQUIRE(allowed.contains(room));
    for (const Include& include : IncludesOf(file)) {
      const std::string other = RoomOf(include.path);
      if (!include.quoted || include.path.ends_with(".pb.h") || other == room) continue;
      if (other == "proto/base" || (other == "proto/wire" && room != "proto/base")) continue;
      used[room].insert(other);
      INFO(At(file, include));
      CHECK(allowed.at(room).contains(other));
    }
  }
  for (const auto& [room, others] : allowed) {
    INFO(room << " may include what it does not");
    CHECK(others == used[room]);
  }
}

TEST_CASE("Arrows between rooms go down, so that they make no circle") {
  const std::map<std::string, size_t> layers = Layers();
  for (const auto& [room, others] : AllowedArrows()) {
    INFO(room);
    REQUIRE(layers.contains(room));
    for (const std::string& other : others) {
      INFO("includes " << other);
      REQUIRE(layers.contains(other));
      CHECK(layers.at(room) < layers.at(other));
    }
  }
}

TEST_CASE("No room is crowded") {
  constexpr size_t kMaxFiles = 26;
  std::map<std::string, size_t> files;
  for (const SourceFile& file : ReadTree({".h", ".cc", ".py"})) ++files[RoomOf(file.path)];
  for (const auto& [room, count] : files) {
    INFO(room);
    CHECK(count <= kMaxFiles);
  }
}

TEST_CASE("Quoted includes are files of this project, named from its root") {
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    for (const Include& include : IncludesOf(file)) {
      if (!include.quoted || include.path.ends_with(".pb.h")) continue;
      INFO(At(file, include));
      CHECK(std::filesystem::exists(std::filesystem::path(B4MRL_SOURCE_DIR) / include.path));
    }
  }
}

TEST_CASE("The highway simulator includes nothing but itself and the standard library") {
  size_t files = 0;
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    if (!file.In("server/highway/")) continue;
    ++files;
    for (const Include& include : IncludesOf(file)) {
      INFO(At(file, include));
      CHECK((include.quoted ? include.path.starts_with("server/highway/")
                            : include.path.find_first_of("./") == std::string::npos));
    }
  }
  CHECK(files > 10);
}

TEST_CASE("Each third-party library has one door") {
  std::set<std::string> seen;
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    for (const Include& include : IncludesOf(file)) {
      for (const Door& door : kDoors) {
        if (include.quoted || !StartsWithAny(include.path, door.headers)) continue;
        seen.insert(door.library);
        INFO(At(file, include) << ", which is " << door.library);
        CHECK((SeesAll(file) || StartsWithAny(file.path, door.prefixes)));
      }
    }
  }
  for (const Door& door : kDoors) {
    INFO(door.library);
    CHECK(seen.contains(door.library));  // the prefixes above still match what is included
  }
}

TEST_CASE("Libraries log through spdlog, not through iostream") {
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    if (SeesAll(file)) continue;
    for (const Include& include : IncludesOf(file)) {
      INFO(At(file, include));
      CHECK(include.path != "iostream");
    }
  }
}

TEST_CASE("Headers are guarded by pragma once") {
  for (const SourceFile& file : ReadTree({".h"})) {
    INFO(file.path);
    CHECK(std::count(file.lines.begin(), file.lines.end(), "#pragma once") == 1);
  }
}

}  // namespace
}  // namespace b4mrl

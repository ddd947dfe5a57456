// The arrows between folders, and which folder may include which third-party library.
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <set>

#include "tests/architecture/source_tree.h"

namespace b4mrl {
namespace {

// Folder -> folders that its files may include. tests and benchmarks/performance may see all.
const std::map<std::string, std::set<std::string>> kArrows = {
    {"proto", {"proto"}},
    {"data", {"proto", "data"}},
    {"client", {"proto", "client"}},
    {"server", {"proto", "data", "server"}},
    {"algorithms", {"proto", "data", "client", "algorithms"}},
    {"benchmarks", {"proto", "data", "client", "algorithms", "benchmarks"}},
};

bool SeesAll(const SourceFile& file) {
  return file.folder == "tests" || file.In("benchmarks/performance/");
}

struct Door {
  std::string library;
  std::vector<std::string> headers;   // prefixes of what stands between < and >, or quotes
  std::vector<std::string> prefixes;  // of the paths that may include them
};

const std::vector<Door> kDoors = {
    {"ZeroMQ", {"zmq"}, {"proto/wire/"}},
    {"HDF5", {"hdf5", "H5"}, {"data/"}},
    {"MuJoCo", {"mujoco/"}, {"server/environments/", "server/perturbations/", "server/render/"}},
    {"OSMesa", {"GL/"}, {"server/render/"}},
    {"Cairo", {"cairo"}, {"server/render/"}},
    {"TinyXML", {"tinyxml2"}, {"server/models/model_scan"}},
    {"Eigen", {"Eigen/"}, {"algorithms/"}},
    {"BLAS", {"cblas", "openblas", "lapacke"}, {"algorithms/"}},
    {"Catch2", {"catch2/"}, {"tests/"}},
};

bool StartsWithAny(const std::string& text, const std::vector<std::string>& prefixes) {
  return std::any_of(prefixes.begin(), prefixes.end(),
                     [&](const std::string& prefix) { return text.starts_with(prefix); });
}

std::string At(const SourceFile& file, const Include& include) {
  return file.path + ":" + std::to_string(include.line) + " includes " + include.path;
}

TEST_CASE("Includes follow the arrows between folders") {
  size_t checked = 0;
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    if (SeesAll(file)) continue;
    const std::set<std::string>& allowed = kArrows.at(file.folder);
    for (const Include& include : IncludesOf(file)) {
      if (!include.quoted) continue;
      INFO(At(file, include));
      CHECK(allowed.contains(include.path.substr(0, include.path.find('/'))));
      ++checked;
    }
  }
  CHECK(checked > 100);  // the tree was found
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

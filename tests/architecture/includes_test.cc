// The arrows between folders, and which folder may include which third-party library.
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <set>

#include "tests/architecture/source_tree.h"

namespace b4mrl {
namespace {

// Room -> rooms that its files may include, itself and proto/ excepted. The picture in
// ARCHITECTURE.md shows the same arrows. tests and benchmarks/performance may see all.
const std::map<std::string, std::set<std::string>> kArrows = {
    {"proto/base", {}},
    {"proto/wire", {}},

    {"data/files", {}},
    {"data/columns", {"data/files"}},
    {"data/hdf5", {"data/files"}},
    {"data/d4rl", {"data/columns", "data/files", "data/hdf5"}},

    {"client", {}},
    {"client/examples", {"client"}},

    {"server/shared_memory", {}},
    {"server/replies", {}},
    {"server/sandbox", {}},
    {"server/scheduling", {}},
    {"server/highway", {}},
    {"server/environments", {"server/highway"}},
    {"server/environments/mujoco", {"server/environments"}},
    {"server/perturbations",
     {"server/environments", "server/environments/mujoco", "server/highway"}},
    {"server/simulator",
     {"server/environments", "server/environments/mujoco", "server/perturbations"}},
    {"server/render", {"server/simulator"}},
    {"server/render/painter", {"server/environments", "server/render", "server/simulator"}},
    {"server/process", {"server/shared_memory"}},
    {"server/supervisor", {"server/process", "server/shared_memory"}},
    {"server/models",
     {"data/files", "server/environments", "server/environments/mujoco", "server/perturbations",
      "server/sandbox", "server/simulator"}},
    {"server/datasets",
     {"data/columns", "data/d4rl", "data/files", "server/environments", "server/perturbations",
      "server/process", "server/replies", "server/sandbox"}},
    {"server/worker",
     {"server/environments/mujoco", "server/process", "server/render", "server/replies",
      "server/scheduling", "server/shared_memory", "server/simulator"}},
    {"server/gateway",
     {"data/files", "server/environments", "server/environments/mujoco", "server/models",
      "server/perturbations", "server/process", "server/replies", "server/shared_memory"}},
    {"server", {"server/datasets", "server/models", "server/process", "server/supervisor"}},

    {"algorithms/nn/products", {}},
    {"algorithms/nn", {"algorithms/nn/products"}},
    {"algorithms/policy", {"algorithms/nn/products", "data/d4rl"}},
    {"algorithms/base", {"algorithms/nn", "algorithms/policy", "data/hdf5"}},
    {"algorithms/cores", {"algorithms/nn", "algorithms/nn/products", "algorithms/policy"}},
    {"algorithms/experience",
     {"algorithms/base", "algorithms/cores", "algorithms/nn/products", "algorithms/policy",
      "client"}},
    {"algorithms/model",
     {"algorithms/base", "algorithms/cores", "algorithms/experience", "algorithms/nn",
      "algorithms/nn/products", "algorithms/policy", "client", "data/files"}},
    {"algorithms/learners",
     {"algorithms/base", "algorithms/cores", "algorithms/experience", "algorithms/model",
      "algorithms/policy", "data/hdf5"}},
    {"algorithms", {"algorithms/base", "algorithms/experience", "algorithms/learners"}},
    {"algorithms/episodes", {"algorithms/base", "algorithms/policy", "client", "data/d4rl"}},
    {"algorithms/run",
     {"algorithms", "algorithms/base", "algorithms/episodes", "algorithms/nn/products",
      "algorithms/policy", "client", "data/d4rl", "data/files"}},
    {"algorithms/tools",
     {"algorithms", "algorithms/base", "algorithms/episodes", "algorithms/policy", "algorithms/run",
      "client", "data/d4rl", "data/files"}},
};

bool SeesAll(const SourceFile& file) {
  return file.folder == "tests" || file.In("benchmarks/performance/");
}

std::string RoomOf(const std::string& path) { return path.substr(0, path.rfind('/')); }

// The rooms from which an arrow leads back to `room`, over others or directly.
bool LeadsTo(const std::string& from, const std::string& room, std::set<std::string>& visited) {
  for (const std::string& next : kArrows.at(from)) {
    if (next == room) return true;
    if (visited.insert(next).second && LeadsTo(next, room, visited)) return true;
  }
  return false;
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

TEST_CASE("Includes follow the arrows between rooms") {
  std::set<std::pair<std::string, std::string>> used;
  for (const SourceFile& file : ReadTree({".h", ".cc"})) {
    if (SeesAll(file)) continue;
    const std::string room = RoomOf(file.path);
    INFO(file.path << " stands in " << room << ", which is not among the rooms above");
    REQUIRE(kArrows.contains(room));
    for (const Include& include : IncludesOf(file)) {
      const std::string other = RoomOf(include.path);
      if (!include.quoted || include.path.ends_with(".pb.h") || other == room) continue;
      used.emplace(room, other);
      INFO(At(file, include));
      const bool base = other == "proto/base" || (other == "proto/wire" && room != "proto/base");
      CHECK((base || kArrows.at(room).contains(other)));
    }
  }
  for (const auto& [room, others] : kArrows) {
    for (const std::string& other : others) {
      INFO(room << " > " << other << " is used by nobody");
      CHECK(used.contains({room, other}));
    }
  }
}

TEST_CASE("No arrows between rooms make a circle") {
  for (const auto& [room, others] : kArrows) {
    std::set<std::string> visited;
    INFO(room);
    CHECK_FALSE(LeadsTo(room, room, visited));
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

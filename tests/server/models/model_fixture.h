// Models folders for tests: the tasks' own MJCF files, edited.
#pragma once

#include <catch2/catch.hpp>
#include <string>

#include "server/environments/list.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

// The text of a task's own model.
inline std::string OwnModel(const std::string& file_name) {
  return ReadBytes(DefaultModelsFolder() + "/" + file_name);
}

// `text` with one occurrence of `before` replaced.
inline std::string Edited(std::string text, const std::string& before, const std::string& after) {
  const size_t at = text.find(before);
  INFO(before);
  REQUIRE(at != std::string::npos);
  return text.replace(at, before.size(), after);
}

// The Hopper's own model with `after` in place of `before`.
inline std::string EditedHopper(const std::string& before, const std::string& after) {
  return Edited(OwnModel("hopper.xml"), before, after);
}

}  // namespace b4mrl

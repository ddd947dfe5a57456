// What a run logged, as tests compare it.
#pragma once

#include <catch2/catch.hpp>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace b4mrl {

inline std::vector<nlohmann::json> LoggedRows(const std::string& folder) {
  std::vector<nlohmann::json> rows;
  std::ifstream lines(folder + "/metrics.jsonl");
  for (std::string line; std::getline(lines, line);) {
    rows.push_back(nlohmann::json::parse(line, nullptr, /*allow_exceptions=*/false));
    REQUIRE(rows.back().is_object());
  }
  return rows;
}

// Without what depends on timing: the clock, and the rows of a dataset that the daemon had served
// by then. Batches are requested ahead of their use, so a resumed run asks for some of them again.
inline std::vector<nlohmann::json> RowsWithoutTimes(const std::string& folder) {
  std::vector<nlohmann::json> rows = LoggedRows(folder);
  for (nlohmann::json& row : rows) {
    row.erase("seconds");
    row.erase("updates_per_second");
    row.erase("dataset_rows");
  }
  return rows;
}

}  // namespace b4mrl

#include "data/csv/dataset_csv_writer.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <sstream>

#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

std::vector<std::string> Split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, separator);) parts.push_back(part);
  return parts;
}

std::vector<std::string> LinesOf(const ExampleDataset& data) {
  const TemporaryFolder folder;
  auto writer =
      DatasetCsvWriter::Create(folder.File("x.csv"), data.observation_size, data.action_size);
  REQUIRE(writer.ok());
  REQUIRE(writer->Append(data.Rows(0, 1)).ok());
  REQUIRE(writer->Append(data.Rows(1, data.rows() - 1)).ok());
  CHECK_FALSE(std::filesystem::exists(folder.File("x.csv")));
  REQUIRE(writer->Commit().ok());
  return Split(ReadBytes(folder.File("x.csv")), '\n');
}

// As NumPy and pandas read a number into float32: by way of float64.
float ReadBack(const std::string& text) {
  return static_cast<float>(std::strtod(text.c_str(), nullptr));
}

TEST_CASE("a table has a header and a line for each row, and reads back to the same bits") {
  const ExampleDataset data = MakeExampleDataset({3, 2}, 2, 1);
  const std::vector<std::string> lines = LinesOf(data);
  REQUIRE(lines.size() == 6);
  CHECK(lines[0] ==
        "observation_0,observation_1,action_0,reward,next_observation_0,next_observation_1,"
        "terminal,timeout");
  for (size_t row = 0; row < data.rows(); ++row) {
    const std::vector<std::string> cells = Split(lines[row + 1], ',');
    REQUIRE(cells.size() == 8);
    CHECK(ReadBack(cells[0]) == data.observations[2 * row]);
    CHECK(ReadBack(cells[1]) == data.observations[2 * row + 1]);
    CHECK(ReadBack(cells[2]) == data.actions[row]);
    CHECK(ReadBack(cells[3]) == data.rewards[row]);
    CHECK(ReadBack(cells[5]) == data.next_observations[2 * row + 1]);
    CHECK(cells[6] == (data.terminals[row] != 0 ? "1" : "0"));
    CHECK(cells[7] == (data.timeouts[row] != 0 ? "1" : "0"));
  }
}

TEST_CASE("numbers that are not finite, or that float64 would round twice, keep their value") {
  ExampleDataset data = MakeExampleDataset({6}, 1, 1);
  // The shortest text of the last one, 7.038531e-26, has a float64 in the middle between two
  // float32, which rounds to the other one.
  const float hard = 7.038531e-26f;
  REQUIRE(ReadBack("7.038531e-26") != hard);
  data.rewards = {std::numeric_limits<float>::quiet_NaN(),
                  -std::numeric_limits<float>::quiet_NaN(),
                  std::numeric_limits<float>::infinity(),
                  -std::numeric_limits<float>::infinity(),
                  -0.0f,
                  hard};
  const std::vector<std::string> lines = LinesOf(data);
  std::vector<std::string> rewards;
  for (size_t row = 0; row < data.rows(); ++row) rewards.push_back(Split(lines[row + 1], ',')[2]);
  CHECK(rewards[0] == "nan");
  CHECK(rewards[1] == "nan");
  CHECK(rewards[2] == "inf");
  CHECK(rewards[3] == "-inf");
  CHECK(std::signbit(ReadBack(rewards[4])));
  CHECK(ReadBack(rewards[5]) == hard);
}

TEST_CASE("rows of other sizes than the table's are refused") {
  const TemporaryFolder folder;
  const ExampleDataset data = MakeExampleDataset({3}, 2, 1);
  auto writer = DatasetCsvWriter::Create(folder.File("x.csv"), 3, 1);
  REQUIRE(writer.ok());
  CHECK(writer->Append(data.Rows()).code() == StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace b4mrl

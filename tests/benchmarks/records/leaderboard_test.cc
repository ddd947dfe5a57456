// The leaderboard puts the results of equal cells together and ranks the cells of a benchmark.
#include "benchmarks/records/leaderboard.h"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

using Json = nlohmann::json;

// A finished result of an algorithm with a cell of its own, for two benchmarks.
Json ResultOf(const std::string& algorithm, uint64_t seed, double score) {
  return {{"cell", algorithm},
          {"benchmarks", {"E/b", "E/a"}},
          {"algorithm", algorithm},
          {"recipe", nullptr},
          {"source", "own"},
          {"score", score},
          {"return", score * 10},
          {"returns", std::vector<double>(10, score * 10)},
          {"seed", seed},
          {"updates", 100},
          {"finished", true},
          {"settled", true},
          {"precision", "fp32"},
          {"seconds", 1800},
          {"dataset", {{"name", "E/data-v0"}, {"rows", 9}, {"columns_sha256", "aa"}}},
          {"ledger", {{"simulator_steps", 1}, {"query_rows", 2}, {"dataset_rows", 3}}}};
}

std::vector<Benchmark> TestBenchmarks() {
  std::vector<Benchmark> benchmarks(5);
  benchmarks[0].name = "E/a";
  benchmarks[1].name = "E/none";
  benchmarks[2].name = "E/b";
  benchmarks[3].name = "E/x,y";
  benchmarks[4].name = "E/versioned";
  benchmarks[4].dataset = "E/data";
  return benchmarks;
}

class Results {
 public:
  void Add(const Json& result) {
    WriteBytes(folder_.File(std::to_string(count_++) + ".json"), result.dump());
  }
  // What cannot be read.
  std::vector<std::string> Skipped() const {
    std::vector<std::string> skipped;
    Take(Leaderboard(folder_.path(), TestBenchmarks(), PublishedDatasets(), &skipped));
    return skipped;
  }
  // The rows without the columns' names.
  std::vector<std::string> Rows() const {
    PublishedDatasets published;
    published["E/data-v0"].columns_sha256 = "aa";
    const std::string csv = Take(Leaderboard(folder_.path(), TestBenchmarks(), published));
    std::vector<std::string> rows;
    for (size_t at = csv.find('\n') + 1; at < csv.size();) {
      const size_t end = csv.find('\n', at);
      rows.push_back(csv.substr(at, end - at));
      at = end + 1;
    }
    return rows;
  }

 private:
  TemporaryFolder folder_;
  int count_ = 0;
};

TEST_CASE("Rows come in the order of benchmarks, the best algorithm first") {
  Results results;
  results.Add(ResultOf("low", 0, 10));
  results.Add(ResultOf("high", 0, 30));
  const auto rows = results.Rows();
  REQUIRE(rows.size() == 4);
  CHECK(rows[0] == "E/a,high,,own,E/data-v0,9,aa,30.00,,300.0,,1,100,yes,fp32,0.50,1,2,3,no");
  CHECK(rows[1].starts_with("E/a,low,"));
  CHECK(rows[2].starts_with("E/b,high,"));
  CHECK(rows[3].starts_with("E/b,low,"));
}

TEST_CASE("Seeds of a cell are averaged, and three of them are an entry") {
  Results results;
  for (uint64_t seed = 0; seed < 3; ++seed) {
    results.Add(ResultOf("mine", seed, 10 + 3 * static_cast<double>(seed)));
  }
  CHECK(results.Rows()[0] ==
        "E/a,mine,,own,E/data-v0,9,aa,13.00,2.45,130.0,24.5,3,100,yes,fp32,0.50,1,2,3,yes");
}

TEST_CASE("Seeds with different updates have no mean of them") {
  Results results;
  for (uint64_t seed = 0; seed < 2; ++seed) {
    Json result = ResultOf("mine", seed, 10);
    if (seed == 1) result["updates"] = 400;
    results.Add(result);
  }
  CHECK(results.Rows()[0].find(",2,100-400,yes,") != std::string::npos);
}

TEST_CASE("A seed counts once, as often as it was trained in another precision") {
  Results results;
  Json other = ResultOf("mine", 0, 70);
  other["precision"] = "bf16";
  results.Add(other);
  results.Add(ResultOf("mine", 0, 10));
  results.Add(ResultOf("mine", 1, 20));
  CHECK(results.Rows().front().starts_with("E/a,mine,,own,E/data-v0,9,aa,15.00,"));
}

TEST_CASE("Rows of different data, precisions or scorers are no entry") {
  const std::pair<const char*, Json> changes[] = {{"/precision", "bf16"},
                                                  {"/updates", 50},
                                                  {"/source", "self-scored"},
                                                  {"/dataset/columns_sha256", "bb"},
                                                  {"/returns", {1, 2, 3}},
                                                  {"/seed", 0},
                                                  {"/seed", 7}};
  for (const auto& [key, value] : changes) {
    CAPTURE(key);
    Results results;
    for (uint64_t seed = 0; seed < 3; ++seed) {
      Json result = ResultOf("mine", seed, 10);
      if (seed == 1) result[Json::json_pointer(key)] = value;
      results.Add(result);
    }
    CHECK(results.Rows()[0].ends_with(",no"));
  }
}

TEST_CASE("Results on other rows, of another world or another scorer are a row of their own") {
  struct Change {
    const char *key, *value, *row;
  };
  for (const Change& change :
       {Change{"/dataset/columns_sha256", "bb", "E/a,mine,,own,E/data-v0,9,bb,20.00,,200.0,,1,"},
        Change{"/simulator", "friction=2", "E/a,mine,,own,E/data-v0,9,aa,20.00,,200.0,,1,"},
        Change{"/corruption", "friction=2", "E/a,mine,,own,E/data-v0,9,aa,20.00,,200.0,,1,"},
        Change{"/world", "friction=2", "E/a,mine,,own,E/data-v0,9,aa,20.00,,200.0,,1,"},
        Change{"/source", "self-scored",
               "E/a,mine,,self-scored,E/data-v0,9,aa,20.00,,200.0,,1,"}}) {
    CAPTURE(change.key);
    Results results;
    results.Add(ResultOf("mine", 0, 10));
    Json other = ResultOf("mine", 1, 20);
    other[Json::json_pointer(change.key)] = change.value;
    results.Add(other);
    const auto rows = results.Rows();
    REQUIRE(rows.size() == 4);
    CHECK(rows[0].starts_with(change.row));
    CHECK(rows[1].starts_with("E/a,mine,,own,E/data-v0,9,aa,10.00,,100.0,,1,"));
  }
}

TEST_CASE("Control characters of a name reach no terminal") {
  Results results;
  results.Add(ResultOf("a\x1b[2J\nb\xc2\x9b", 0, 10));
  CHECK(results.Rows()[0].starts_with("E/a,a\uFFFD[2J\uFFFDb\uFFFD,,own,"));
}

TEST_CASE("Three seeds on other data than the published ones are no entry") {
  const auto entry = [](const Json& dataset) {
    Results results;
    for (uint64_t seed = 0; seed < 3; ++seed) {
      Json result = ResultOf("mine", seed, 10);
      result["dataset"] = dataset;
      results.Add(result);
    }
    const std::string row = results.Rows()[0];
    return row.substr(row.rfind(',') + 1);
  };
  CHECK(entry({{"name", "E/data-v0"}, {"rows", 3}, {"columns_sha256", "cc"}}) == "no");
  CHECK(entry({{"name", "d4rl/e-data-v2"}, {"rows", 9}, {"columns_sha256", "aa"}}) == "no");
  CHECK(entry(nullptr) == "yes");  // as of SAC, which has no dataset
}

TEST_CASE("A seed that was run twice makes no entry") {
  Results results;
  for (const uint64_t seed : {0, 1, 2, 2}) results.Add(ResultOf("mine", seed, 10));
  CHECK(results.Rows()[0] ==
        "E/a,mine,,own,E/data-v0,9,aa,10.00,0.00,100.0,0.0,3,100,yes,fp32,0.50,1,2,3,no");
}

TEST_CASE("A run that two files tell of counts once, as far as it came") {
  Results results;
  for (const uint64_t updates : {80, 100, 60}) {
    Json json = ResultOf("mine", 0, static_cast<double>(updates));
    json["id"] = "one";
    json["updates"] = updates;
    results.Add(json);
  }
  CHECK(results.Rows()[0].starts_with("E/a,mine,,own,E/data-v0,9,aa,100.00,,1000.0,,1,100,"));
}

TEST_CASE("Copies of one seed under other numbers, and unknown scorers, are no entry") {
  const auto entry = [](bool are_copies, const std::string& source) {
    Results results;
    for (const uint64_t seed : {0, 1, 2}) {
      Json json = ResultOf("mine", seed, 10);
      const double score = are_copies ? 10 : 10 + static_cast<double>(seed);
      json["source"] = source;
      json["curve"] = Json::array();
      for (int i = 1; i <= 5; ++i) json["curve"].push_back({i * 20, 0, 10 * score + i, 1.0, score});
      results.Add(json);
    }
    const std::string row = results.Rows()[0];
    return row.substr(row.rfind(',') + 1);
  };
  CHECK(entry(false, "own") == "yes");
  CHECK(entry(true, "own") == "no");
  CHECK(entry(false, "") == "no");
}

TEST_CASE("Copies of one seed count once, and are named") {
  Results results;
  for (const uint64_t seed : {0, 1, 2}) {
    Json json = ResultOf("mine", seed, 10);
    json["curve"] = Json::array();
    for (int i = 1; i <= 5; ++i) json["curve"].push_back({i * 20, 0, 100 + i, 1.0, 10});
    results.Add(json);
  }
  CHECK(results.Rows()[0] ==
        "E/a,mine,,own,E/data-v0,9,aa,10.00,,100.0,,1,100,yes,fp32,0.50,1,2,3,no");
  CHECK(results.Skipped().size() == 2);
}

TEST_CASE("A result on another version of a benchmark's dataset is no row of it") {
  Results results;
  Json json = ResultOf("mine", 0, 10);
  json["benchmarks"] = {"E/a", "E/versioned"};
  results.Add(json);
  const auto rows = results.Rows();
  REQUIRE(rows.size() == 1);
  CHECK(rows[0].starts_with("E/a,"));
  REQUIRE(results.Skipped().size() == 1);
  CHECK_THAT(results.Skipped()[0],
             Catch::Contains("its dataset is E/data-v0, its benchmark's E/data"));
}

TEST_CASE("A cell fills the benchmarks that one of its seeds names") {
  Results results;
  for (const uint64_t seed : {0, 1}) {
    Json json = ResultOf("iql", seed, 10 + static_cast<double>(seed));
    json["benchmarks"] = {"E/a"};
    if (seed == 1) json["benchmarks"].push_back("E/b");
    results.Add(json);
  }
  const auto rows = results.Rows();
  REQUIRE(rows.size() == 2);
  CHECK(rows[0].substr(0, 4) == "E/a,");
  CHECK(rows[1] == "E/b" + rows[0].substr(3));
}

TEST_CASE("Where a curve is too short to say whether it has settled, the column is blank") {
  Results results;
  Json json = ResultOf("mine", 0, 10);
  json["settled"] = nullptr;
  results.Add(json);
  CHECK(results.Rows()[0].find(",1,100,,fp32,") != std::string::npos);
}

TEST_CASE("A name with commas and quotes stays one cell of the table") {
  Results results;
  Json json = ResultOf("b,c \"d\"", 0, 10);
  results.Add(json);
  CHECK(results.Rows()[0].starts_with("E/a,\"b,c \"\"d\"\"\",,own,"));
  // Benchmarks with several perturbations are such names.
  json["benchmarks"] = {"E/x,y"};
  results.Add(json);
  CHECK(results.Rows().back().starts_with("\"E/x,y\",\"b,c "));
}

TEST_CASE("A result that names a benchmark twice counts there once") {
  Results results;
  Json twice = ResultOf("mine", 0, 10);
  twice["benchmarks"] = {"E/a", "E/a"};
  results.Add(twice);
  results.Add(ResultOf("mine", 1, 20));
  CHECK(results.Rows()[0].starts_with("E/a,mine,,own,E/data-v0,9,aa,15.00,5.00,150.0,50.0,2,"));
}

TEST_CASE("A result of benchmarks that are in no suite is named, and its others have their rows") {
  Results results;
  Json own = ResultOf("mine", 0, 10);
  own["benchmarks"] = {"E/own", "E/a", "E/other"};
  results.Add(own);
  REQUIRE(results.Rows().size() == 1);
  CHECK(results.Rows()[0].starts_with("E/a,mine,"));
  REQUIRE(results.Skipped().size() == 1);
  CHECK(results.Skipped()[0].ends_with(
      "0.json: benchmark 'E/own', like 1 more, is in no suite (--suites names a folder of further "
      "ones)"));
}

TEST_CASE("A file that is larger than a result can be is left out and named") {
  Results results;
  Json large = ResultOf("mine", 0, 10);
  large["padding"] = std::string(4 << 20, 'x');
  results.Add(large);
  CHECK(results.Rows().empty());
  REQUIRE(results.Skipped().size() == 1);
  CHECK(results.Skipped()[0].ends_with("0.json is longer than 4194304 bytes"));
}

TEST_CASE("Runs that have not finished, and files that are no results, have no row") {
  Results results;
  Json unfinished = ResultOf("mine", 0, 10);
  unfinished["finished"] = false;
  results.Add(unfinished);
  results.Add(Json::array());
  Json odd = ResultOf("odd", 0, 10);
  odd["benchmarks"] = {3};
  results.Add(odd);
  CHECK(results.Rows().empty());
  CHECK(results.Skipped().size() == 1);
}

}  // namespace
}  // namespace b4mrl

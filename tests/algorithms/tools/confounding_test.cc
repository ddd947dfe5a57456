// Hidden confounding is in the data: what a policy saw and the dataset does not show explains its
// actions.
#include <catch2/catch.hpp>
#include <cmath>
#include <numeric>
#include <span>
#include <string>
#include <vector>

#include "client/remote_dataset.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

constexpr size_t kRows = 20'000;

using Column = std::vector<double>;

// The columns of row-major rows, each less its mean.
std::vector<Column> CentredColumns(std::span<const float> rows) {
  std::vector<Column> columns(rows.size() / kRows, Column(kRows));
  for (size_t k = 0; k < columns.size(); ++k) {
    double sum = 0;
    for (size_t row = 0; row < kRows; ++row) sum += rows[row * columns.size() + k];
    for (size_t row = 0; row < kRows; ++row) {
      columns[k][row] = rows[row * columns.size() + k] - sum / kRows;
    }
  }
  return columns;
}

double Product(const Column& a, const Column& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

// Takes the part of `of` that is a multiple of `explained` away.
void Subtract(const Column& explained, Column* of) {
  const double square = Product(explained, explained);
  if (square == 0) return;
  const double share = Product(explained, *of) / square;
  for (size_t row = 0; row < kRows; ++row) (*of)[row] -= share * explained[row];
}

// A data folder with HalfCheetah/medium and HalfCheetah/random, and a daemon on it.
class Recordings {
 public:
  Recordings() : daemon_(StartDaemon({.data_folder = folder_.path()})) {
    for (const char* name : {"HalfCheetah/medium", "HalfCheetah/random"}) {
      const Outcome made = Run({"dataset", "make", name, "--rows", std::to_string(kRows), "--quiet",
                                "--endpoint", daemon_.endpoint()});
      INFO(made.err);
      REQUIRE(made.exit_code == 0);
    }
  }

  // The share of the actions' variance that a linear function of the served observations explains,
  // of all six actions together, in the rows from which it was fitted.
  double ExplainedVariance(const std::string& name, const std::string& corruption) {
    Client client = Connect(daemon_.endpoint());
    DatasetOptions options;
    options.corruption = Take(ParseNamedArguments(corruption));
    RemoteDataset dataset = Take(client.OpenDataset(name, options));
    const TransitionRows rows = Take(dataset.Read(0, kRows));
    REQUIRE(rows.rows == kRows);
    std::vector<Column> x = CentredColumns(rows.observations);
    const std::vector<Column> y = CentredColumns(rows.actions);
    // Gram and Schmidt: each observation without what those before it explain.
    double explained = 0, all = 0;
    for (const Column& action : y) all += Product(action, action);
    for (size_t i = 0; i < x.size(); ++i) {
      const double before = Product(x[i], x[i]);
      for (size_t j = 0; j < i; ++j) Subtract(x[j], &x[i]);
      const double left = Product(x[i], x[i]);
      if (left <= 1e-12 * before) {  // hidden, or a sum of those before it
        x[i].assign(kRows, 0);
        continue;
      }
      for (const Column& action : y) explained += std::pow(Product(x[i], action), 2) / left;
    }
    return explained / all;
  }

 private:
  TemporaryFolder folder_;
  PrivateDaemon daemon_;
};

TEST_CASE("What the data hide explains the actions of a policy that saw it, and no random ones") {
  Recordings recordings;
  const auto lost = [&](const std::string& name, const std::string& corruption) {
    return recordings.ExplainedVariance(name, "") - recordings.ExplainedVariance(name, corruption);
  };
  // The rows are the same on every machine; the margin is for the order of sums.
  const auto is = [](double value) { return Approx(value).margin(1e-6); };
  CHECK(recordings.ExplainedVariance("HalfCheetah/medium", "") == is(0.6334952));
  CHECK(lost("HalfCheetah/medium", "hidden-high") == is(0.0079143));
  CHECK(lost("HalfCheetah/medium", "hidden-low") == is(0.0052341));
  CHECK(lost("HalfCheetah/medium", "obs-noise-low") == is(0.0003360));
  CHECK(lost("HalfCheetah/medium", "obs-noise-high") == is(0.0067534));
  // Uniform actions depend on nothing: what chance explains in so many rows is below 0.002.
  CHECK(recordings.ExplainedVariance("HalfCheetah/random", "") < 0.002);
  CHECK(lost("HalfCheetah/random", "hidden-high") < 0.0005);
}

}  // namespace
}  // namespace b4mrl

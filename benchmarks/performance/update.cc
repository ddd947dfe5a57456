// Gradient steps a second on one thread, against the rate that one core reaches in sgemm 256^3.
#include <cblas.h>

#include <functional>
#include <vector>

#include "algorithms/cores/h2o_core.h"
#include "algorithms/cores/iql_core.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/cores/td3_core.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/nn/products/blas.h"
#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/processor_time.h"
#include "proto/base/rng.h"

namespace b4mrl::perf {
namespace {

constexpr int kObservation = 17;  // HalfCheetah's size
constexpr int kAction = 6;
constexpr int kBatch = 256;

// Floating-point operations of the matrix products that one update needs, in 1e9 (batch 256, two
// hidden layers of 256; ensemble: seven members of four layers of 200). In SAC's and H2O's actor
// step, each column of the batch takes the backward pass of one critic only.
constexpr double kSacGflop = 0.546;
constexpr double kTd3Gflop = 0.415;
constexpr double kIqlGflop = 0.572;
constexpr double kH2oGflop = 1.206;  // with 512 columns for the discriminators, 1,408 for the gap
constexpr double kEnsembleGflop = 1.40;

MatrixBuffer<float> RandomMatrix(int rows, int columns, std::string_view purpose) {
  MatrixBuffer<float> matrix(rows, columns);
  Rng rng(0, purpose);
  rng.FillNormal({matrix.view().data, static_cast<size_t>(rows) * columns});
  return matrix;
}

// A batch with plausible numbers; its content does not change the work.
struct RandomBatch {
  explicit RandomBatch(int columns)
      : observations(RandomMatrix(kObservation, columns, "observations")),
        actions(RandomMatrix(kAction, columns, "actions")),
        next_observations(RandomMatrix(kObservation, columns, "next")),
        rewards(columns, 1.0f),
        not_terminated(columns, 1.0f) {
    for (float& action : actions.values()) action = action > 0 ? 0.5f : -0.5f;
  }
  TransitionBatch<float> view() const {
    return {observations.view(), actions.view(), rewards, next_observations.view(), not_terminated};
  }

  MatrixBuffer<float> observations, actions, next_observations;
  std::vector<float> rewards, not_terminated;
};

// Calls per second of this thread's processor time, over about `seconds` of processor time. Other
// programs on the machine hardly change this rate.
double CallRate(double seconds, const std::function<void()>& call) {
  const double start = ThreadSeconds();
  double elapsed = 0;
  int64_t calls = 0;
  do {
    for (int i = 0; i < 16; ++i) call();
    calls += 16;
    elapsed = ThreadSeconds() - start;
  } while (elapsed < seconds);
  return static_cast<double>(calls) / elapsed;
}

// Rate of sgemm 256 x 256 x 256, in 1e9 floating-point operations a second.
double SgemmGflops(double seconds) {
  constexpr int kSize = 256;
  static MatrixBuffer<float> a = RandomMatrix(kSize, kSize, "a");
  static MatrixBuffer<float> b = RandomMatrix(kSize, kSize, "b");
  static MatrixBuffer<float> c(kSize, kSize);
  const double rate = CallRate(seconds, [] {
    cblas_sgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, kSize, kSize, kSize, 1.0f, a.view().data,
                kSize, b.view().data, kSize, 0.0f, c.view().data, kSize);
  });
  return rate * 2.0 * kSize * kSize * kSize / 1e9;
}

// One learner's row: its update's rate in one precision.
struct Row {
  std::string_view name;
  double gflop;
  double target;       // in fp32
  double bf16_target;  // against the same sgemm
};

constexpr Row kSac = {"update-sac", kSacGflop, 0.82, 1.40};
constexpr Row kTd3 = {"update-td3", kTd3Gflop, 0.82, 1.40};
constexpr Row kTd3Bc = {"update-td3-bc", kTd3Gflop, 0.82, 1.40};
constexpr Row kIql = {"update-iql", kIqlGflop, 0.82, 1.25};
constexpr Row kH2o = {"update-h2o", kH2oGflop, 0.82, 1.25};
constexpr Row kEnsemble = {"update-ensemble", kEnsembleGflop, 0.80, 1.25};

// What a row is measured with, and where it goes.
struct Measurement {
  const Options& options;
  Precision precision;
  const RandomBatch& batch;
  Reporter& reporter;
};

Status MeasureRow(const Measurement& measurement, const Row& row,
                  const std::function<void()>& update) {
  const double seconds = measurement.options.seconds;
  const bool bf16 = measurement.precision == Precision::kBf16;
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          measurement.options.turns, [&]() -> Result<double> { return CallRate(seconds, update); },
          [&]() -> Result<double> { return SgemmGflops(seconds / 2) / row.gflop; }));
  measurement.reporter.Report({std::string(row.name) + (bf16 ? "-bf16" : ""), medians.value, "1/s",
                               medians.limit,
                               "sgemm 256^3 over the products' " +
                                   std::to_string(row.gflop).substr(0, 5) + " GFLOP, one thread",
                               bf16 ? row.bf16_target : row.target, false});
  return Status();
}

template <typename CoreOptions>
void SetSizes(const Measurement& measurement, CoreOptions& options) {
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.precision = measurement.precision;
}

Status MeasureSac(const Measurement& measurement) {
  SacOptions options;
  SetSizes(measurement, options);
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core, SacCore<float>::Create(options));
  return MeasureRow(measurement, kSac, [&] { core.Update(measurement.batch.view()); });
}

Status MeasureTd3(const Measurement& measurement, const Row& row, std::optional<double> bc_alpha) {
  Td3Options options;
  SetSizes(measurement, options);
  options.bc_alpha = bc_alpha;
  B4MRL_ASSIGN_OR_RETURN(Td3Core<float> core, Td3Core<float>::Create(options));
  return MeasureRow(measurement, row, [&] { core.Update(measurement.batch.view()); });
}

Status MeasureIql(const Measurement& measurement) {
  IqlOptions options;
  SetSizes(measurement, options);
  B4MRL_ASSIGN_OR_RETURN(IqlCore<float> core, IqlCore<float>::Create(options));
  return MeasureRow(measurement, kIql, [&] { core.Update(measurement.batch.view()); });
}

Status MeasureH2o(const Measurement& measurement) {
  H2oOptions options;
  SetSizes(measurement, options);
  options.gap_noise.assign(kObservation, 0.3);
  B4MRL_ASSIGN_OR_RETURN(H2oCore<float> core, H2oCore<float>::Create(options));
  const RandomBatch discriminator_batch(2 * kBatch);
  return MeasureRow(measurement, kH2o, [&] {
    core.Update({measurement.batch.view(), kBatch / 2}, {discriminator_batch.view(), kBatch});
  });
}

Status MeasureEnsemble(const Measurement& measurement) {
  DynamicsEnsembleOptions options;
  SetSizes(measurement, options);
  B4MRL_ASSIGN_OR_RETURN(auto ensemble, DynamicsEnsemble<float>::Create(options));
  const MatrixBuffer<float> inputs = RandomMatrix(kObservation + kAction, kBatch, "inputs");
  const MatrixBuffer<float> targets = RandomMatrix(kObservation + 1, kBatch, "targets");
  return MeasureRow(measurement, kEnsemble,
                    [&] { ensemble.UpdateOnBatch(inputs.view(), targets.view()); });
}

Status MeasureAll(const Measurement& measurement) {
  B4MRL_RETURN_IF_ERROR(MeasureSac(measurement));
  B4MRL_RETURN_IF_ERROR(MeasureTd3(measurement, kTd3, std::nullopt));
  B4MRL_RETURN_IF_ERROR(MeasureTd3(measurement, kTd3Bc, 2.5));
  B4MRL_RETURN_IF_ERROR(MeasureIql(measurement));
  B4MRL_RETURN_IF_ERROR(MeasureH2o(measurement));
  return MeasureEnsemble(measurement);
}

}  // namespace

Status MeasureUpdate(const Options& options, Reporter& reporter) {
  UseOneBlasThread();
  const RandomBatch batch(kBatch);
  B4MRL_RETURN_IF_ERROR(MeasureAll({options, Precision::kFp32, batch, reporter}));
  return HasBf16() ? MeasureAll({options, Precision::kBf16, batch, reporter}) : Status();
}

}  // namespace b4mrl::perf

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

Status MeasureOne(const Options& options, const std::string& name, double gflop, double target,
                  const std::function<void()>& update, Reporter& reporter) {
  const double seconds = options.seconds;
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          options.turns, [&]() -> Result<double> { return CallRate(seconds, update); },
          [&]() -> Result<double> { return SgemmGflops(seconds / 2) / gflop; }));
  reporter.Report({name, medians.value, "1/s", medians.limit,
                   "sgemm 256^3 over the products' " + std::to_string(gflop).substr(0, 5) +
                       " GFLOP, one thread",
                   target, false});
  return Status();
}

Status MeasureTd3(const Options& options, const std::string& name, std::optional<double> bc_alpha,
                  const RandomBatch& batch, Reporter& reporter) {
  Td3Options td3;
  td3.observation_size = kObservation;
  td3.action_size = kAction;
  td3.bc_alpha = bc_alpha;
  B4MRL_ASSIGN_OR_RETURN(Td3Core<float> core, Td3Core<float>::Create(td3));
  return MeasureOne(
      options, name, kTd3Gflop, 0.82, [&] { core.Update(batch.view()); }, reporter);
}

Status MeasureIql(const Options& options, const RandomBatch& batch, Reporter& reporter) {
  IqlOptions iql;
  iql.observation_size = kObservation;
  iql.action_size = kAction;
  B4MRL_ASSIGN_OR_RETURN(IqlCore<float> core, IqlCore<float>::Create(iql));
  return MeasureOne(
      options, "update-iql", kIqlGflop, 0.82, [&] { core.Update(batch.view()); }, reporter);
}

Status MeasureH2o(const Options& options, const RandomBatch& batch, Reporter& reporter) {
  H2oOptions h2o;
  h2o.observation_size = kObservation;
  h2o.action_size = kAction;
  h2o.gap_noise.assign(kObservation, 0.3);
  B4MRL_ASSIGN_OR_RETURN(H2oCore<float> core, H2oCore<float>::Create(h2o));
  const RandomBatch discriminator_batch(2 * kBatch);
  return MeasureOne(
      options, "update-h2o", kH2oGflop, 0.82,
      [&] {
        core.Update({batch.view(), kBatch / 2}, {discriminator_batch.view(), kBatch});
      },
      reporter);
}

Status MeasureEnsemble(const Options& options, Reporter& reporter) {
  DynamicsEnsembleOptions dynamics;
  dynamics.observation_size = kObservation;
  dynamics.action_size = kAction;
  B4MRL_ASSIGN_OR_RETURN(auto ensemble, DynamicsEnsemble<float>::Create(dynamics));
  const MatrixBuffer<float> inputs = RandomMatrix(kObservation + kAction, kBatch, "inputs");
  const MatrixBuffer<float> targets = RandomMatrix(kObservation + 1, kBatch, "targets");
  return MeasureOne(
      options, "update-ensemble", kEnsembleGflop, 0.80,
      [&] { ensemble.UpdateOnBatch(inputs.view(), targets.view()); }, reporter);
}

}  // namespace

Status MeasureUpdate(const Options& options, Reporter& reporter) {
  UseOneBlasThread();
  const RandomBatch batch(kBatch);
  SacOptions sac;
  sac.observation_size = kObservation;
  sac.action_size = kAction;
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core, SacCore<float>::Create(sac));
  B4MRL_RETURN_IF_ERROR(MeasureOne(
      options, "update-sac", kSacGflop, 0.82, [&] { core.Update(batch.view()); }, reporter));
  B4MRL_RETURN_IF_ERROR(MeasureTd3(options, "update-td3", std::nullopt, batch, reporter));
  B4MRL_RETURN_IF_ERROR(MeasureTd3(options, "update-td3-bc", 2.5, batch, reporter));
  B4MRL_RETURN_IF_ERROR(MeasureIql(options, batch, reporter));
  B4MRL_RETURN_IF_ERROR(MeasureH2o(options, batch, reporter));
  return MeasureEnsemble(options, reporter);
}

}  // namespace b4mrl::perf

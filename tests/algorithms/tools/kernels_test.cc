// OpenBLAS's kernels as a user meets them: what they change, and who chooses them.
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "algorithms/nn/products/kernel_choice.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

TEST_CASE("Datasets and scores have equal bytes under another BLAS kernel") {
  TemporaryFolder folder;
  const std::string oldest = "OPENBLAS_CORETYPE=Prescott";
  const auto make = [&](const std::string& data, const Words& environment) {
    const Outcome outcome = Run(
        {"dataset", "make", "HalfCheetah/medium", "--rows", "2000", "--data", folder.File(data)},
        environment);
    INFO(outcome.err);
    REQUIRE(outcome.exit_code == 0);
    return ReadBytes(folder.File(data + "/HalfCheetah/medium-v0.h5"));
  };
  CHECK(make("a", {}) == make("b", {oldest}));

  const Words evaluate = {"evaluate",
                          "--agent",
                          B4MRL_SOURCE_DIR "/data/agents/halfcheetah-medium.h5",
                          "--environment",
                          "HalfCheetah",
                          "--episodes",
                          "2",
                          "--json"};
  const Outcome here = Run(evaluate);
  REQUIRE(here.exit_code == 0);
  CHECK(here.out == Run(evaluate, {oldest}).out);
}

TEST_CASE("A processor that OpenBLAS does not know trains on the best kernels that it can run") {
  const std::string_view best =
      BetterBlasKernels("Prescott", VectorInstructions::OfThisProcessor());
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  WARN("skipped: nothing can be preloaded before a sanitizer");
  return;
#endif
  if (best.empty()) {
    WARN("skipped: this processor has no AVX2, so the oldest kernels are the best");
    return;
  }
  const TemporaryFolder folder;
  const std::string unknown = "LD_PRELOAD=" B4MRL_BINARY_DIR "/libunknown_processor.so";
  const auto kernels = [&](const std::string& name, const Words& environment) {
    const std::string out = folder.File(name);
    const Outcome outcome = Run({"train", "--algorithm", "sac", "--environment", "HalfCheetah",
                                 "--updates", "1", "--warm-up", "300", "--out", out},
                                environment);
    INFO(outcome.err);
    REQUIRE(outcome.exit_code == 0);
    return nlohmann::json::parse(ReadBytes(out + "/run.json"), nullptr, false)["blas_kernel"];
  };
  CHECK(kernels("unknown", {unknown}) == std::string(best));
  CHECK(kernels("chosen", {unknown, "OPENBLAS_CORETYPE=Prescott"}) == "Prescott");
}

}  // namespace
}  // namespace b4mrl

#include "client/benchmark_run.h"

#include <fmt/format.h>

#include <cstdlib>
#include <limits>

#include "proto/base/spec.h"

namespace b4mrl {
namespace {

Result<std::string> Asked(const char* name) {
  const char* value = std::getenv(name);
  if (value != nullptr && *value != '\0') return std::string(value);
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("{} is not set: start this program by `b4mrl benchmark run --learner "
                            "COMMAND --name NAME`",
                            name));
}

Result<uint64_t> AskedNumber(const char* name) {
  B4MRL_ASSIGN_OR_RETURN(const std::string text, Asked(name));
  return ParseUnsigned(name, text, 0, std::numeric_limits<uint64_t>::max());
}

}  // namespace

Result<BenchmarkRun> ReadBenchmarkRun() {
  BenchmarkRun run;
  B4MRL_ASSIGN_OR_RETURN(run.endpoint, Asked("B4MRL_ENDPOINT"));
  B4MRL_ASSIGN_OR_RETURN(run.benchmark, Asked("B4MRL_BENCHMARK"));
  B4MRL_ASSIGN_OR_RETURN(run.seed, AskedNumber("B4MRL_SEED"));
  B4MRL_ASSIGN_OR_RETURN(run.updates, AskedNumber("B4MRL_UPDATES"));
  B4MRL_ASSIGN_OR_RETURN(run.ledger, AskedNumber("B4MRL_LEDGER"));
  B4MRL_ASSIGN_OR_RETURN(run.out, Asked("B4MRL_OUT"));
  return run;
}

}  // namespace b4mrl

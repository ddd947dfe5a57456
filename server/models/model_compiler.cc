#include "server/models/model_compiler.h"

#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "data/files/atomic_file.h"
#include "data/files/file_hash.h"
#include "proto/base/exit_codes.h"
#include "proto/base/limits.h"
#include "proto/wire/json_depth.h"
#include "server/environments/list.h"
#include "server/environments/mujoco/compiled_model.h"
#include "server/models/model_scan.h"
#include "server/perturbations/list.h"
#include "server/sandbox/sandbox.h"
#include "server/sandbox/sandboxed_child.h"
#include "server/simulator/simulator.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr int kTrialSteps = 100;

Result<std::string> DrawTrialName() {
  uint64_t random = 0;
  if (getrandom(&random, sizeof(random), 0) != sizeof(random)) {
    return Status(StatusCode::kInternal, "the system gives no random numbers");
  }
  return fmt::format("{}{:016x}.mjb", kTrialPrefix, random);
}

// Tries a start, and steps with and without motors. Numbers may diverge under random motors, which
// a lane then reports, but not at rest.
Status TryOut(const ModelCompilerOptions& options, const CompiledModel& compiled) {
  SimulatorRequest request;
  request.environment = options.environment;
  request.perturbations = {{"model", options.file_name}};
  request.compiled_model = compiled;
  B4MRL_ASSIGN_OR_RETURN(const std::shared_ptr<const Simulator> simulator,
                         Simulator::Open(request));
  B4MRL_ASSIGN_OR_RETURN(const Simulator::Lease environment, simulator->Borrow());
  const SpaceSpec& space = simulator->spec().action;
  std::vector<double> action(space.size(), 0.0);
  Rng rng(0, "model-trial");
  if (!environment->Reset(rng).ok()) {
    return Status(StatusCode::kInvalidArgument, "the physics engine fails at the start");
  }
  for (int step = 0; step < kTrialSteps; ++step) {
    if (environment->Step(action).cause == Cause::kNumericalError) {
      if (step > 0) break;
      return Status(StatusCode::kInvalidArgument,
                    "the physics engine fails in the first step, with all motors at 0");
    }
    for (size_t i = 0; i < action.size(); ++i) {
      action[i] = rng.Uniform(space.dimensions[i].low, space.dimensions[i].high);
    }
  }
  return Status();
}

Status CheckFile(const ModelCompilerOptions& options) {
  if (!IsModelFileName(options.file_name)) {
    return InvalidArgument("model", options.file_name, "a plain name that ends in .xml");
  }
  struct stat info {};
  if (stat((options.models_folder + "/" + options.file_name).c_str(), &info) != 0) {
    return UnknownName("model", options.file_name, ListModelFiles(options.models_folder));
  }
  if (!S_ISREG(info.st_mode)) {
    return InvalidArgument("model", options.file_name, "a regular file");
  }
  return Status();
}

Result<std::string> CompileInSandbox(const ModelCompilerOptions& options) {
  B4MRL_RETURN_IF_ERROR(CheckFile(options));
  SandboxOptions sandbox;
  sandbox.readable_paths = {options.models_folder};
  sandbox.writable_folder = options.cache_folder;
  sandbox.memory_bytes = limits::kMaxModelCompilerBytes;
  sandbox.cpu_seconds = limits::kMaxModelCompilerSeconds;
  sandbox.file_bytes = limits::kMaxModelBytes;
  sandbox.descriptors = 64;
  B4MRL_RETURN_IF_ERROR(EnterSandbox(sandbox));
  B4MRL_RETURN_IF_ERROR(ScanModelFile(options.models_folder, options.file_name));
  const std::string trial = options.cache_folder + "/" + options.trial_name;
  Result<std::string> hash =
      CompileModelFile(options.models_folder + "/" + options.file_name, trial);
  if (hash.ok()) {
    Status status = TryOut(options, {trial, *hash});
    const std::string path = CompiledModelPath(options.cache_folder, *hash);
    const mode_t mode = ModeInside(options.cache_folder) & 0666;  // as readable as the cache folder
    if (status.ok() &&
        (chmod(trial.c_str(), mode) != 0 || rename(trial.c_str(), path.c_str()) != 0)) {
      status = IoError("create", path, errno);
    }
    if (!status.ok()) hash = status;
  }
  if (!hash.ok()) unlink(trial.c_str());
  return hash;
}

}  // namespace

int RunModelCompiler(const ModelCompilerOptions& options) {
  DieWithParent();
  const Result<std::string> hash = CompileInSandbox(options);
  const std::string answer =
      hash.ok() ? Json({{"ok", true}, {"hash", *hash}}).dump() : ErrorAnswer(hash.status());
  std::printf("%s\n", answer.c_str());
  std::fflush(stdout);
  return hash.ok() ? kExitDone : kExitBadInput;
}

Result<std::string> CompileModelInChild(const std::string& program,
                                        const ModelCompilerOptions& options,
                                        const Deadline& deadline,
                                        const std::atomic<bool>* cancelled) {
  B4MRL_ASSIGN_OR_RETURN(const std::string trial, DrawTrialName());
  const SandboxedChild child = {program,
                                {"--role", "model-compiler", "--models", options.models_folder,
                                 "--file", options.file_name, "--environment", options.environment,
                                 "--cache-folder", options.cache_folder, "--trial", trial},
                                "the model compiler"};
  const ChildAnswer answer = RunSandboxedChild(child, deadline, cancelled);
  if (!answer.ended_well) unlink((options.cache_folder + "/" + trial).c_str());
  const std::string context = "model=" + options.file_name;
  if (!answer.json.ok()) return answer.json.status().WithContext(context);
  const Json hash = ParseShallow<Json>(*answer.json, kMaxAnswerDepth).value("hash", Json());
  if (hash.is_string() && IsHash128(hash.get<std::string>())) return hash.get<std::string>();
  return Status(StatusCode::kDataLoss, context + ": the model compiler gave no usable answer");
}

std::vector<std::string> ListModelFiles(const std::string& models_folder) {
  std::vector<std::string> files;
  std::error_code error;
  for (fs::directory_iterator entry(models_folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    std::string name = entry->path().filename().string();
    if (IsModelFileName(name) && entry->is_regular_file(ignored)) files.push_back(std::move(name));
  }
  std::ranges::sort(files);
  if (files.size() > limits::kMaxModelFiles) files.resize(limits::kMaxModelFiles);
  return files;
}

}  // namespace b4mrl

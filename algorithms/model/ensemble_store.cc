#include "algorithms/model/ensemble_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <span>
#include <system_error>
#include <utility>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "data/files/file_hash.h"
#include "data/files/make_folder.h"
#include "proto/base/clock.h"
#include "proto/base/version.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kUpdatesPerCall = 100;   // training updates per update of the progress bar
constexpr int64_t kUpdatesPerSave = 1000;  // training updates per saved file: about 15 s

// The number of the rule by which training goes on after its first update, whose bits the key holds
// anyway: the order of rows, hold-out errors, which weights are kept, when training ends. Raise it
// with every change of dynamics_training.cc that changes a trained ensemble, so that none that an
// earlier build has trained is taken for one of this build; the version does not change with each.
constexpr int kTrainingRevision = 1;

// --- Keys ---

template <typename T>
void HashValues(StreamHash& hash, std::span<const T> values) {
  const size_t count = values.size();
  hash.Update(std::as_bytes(std::span(&count, 1)));
  hash.Update(std::as_bytes(values));
}

void HashText(StreamHash& hash, const std::string& text) {
  HashValues(hash, std::span<const char>(text));
}

void HashColumns(StreamHash& hash, MatrixView<const float> columns) {
  for (int i = 0; i < columns.columns; ++i) {
    HashValues(hash, std::span(columns.column(i), static_cast<size_t>(columns.rows)));
  }
}

void HashState(StreamHash& hash, DynamicsEnsemble<float>& ensemble) {
  ensemble.VisitArrays([&](const NamedArray<float>& array) {
    HashText(hash, array.name);
    HashValues(hash, std::span<const float>(array.values));
  });
  ensemble.VisitCounters([&](const NamedCounter& counter) {
    HashText(hash, counter.name);
    HashValues(hash, std::span<const int64_t>(counter.value, 1));
  });
}

// All options as text, for the key. The binding names every option, so an option that is missing
// here is a compile error.
std::string Describe(const DynamicsEnsembleOptions& options) {
  const auto& [observation_size, action_size, members, elites, hidden, initialization,
               learning_rate, batch_size, decay, decay_scale, bound_weight, max_log_var,
               min_log_var, bootstrap, scale_inputs, holdout_rule, holdout_fraction, holdout_max,
               min_improvement, patience_epochs, max_updates, seed, precision] = options;
  return fmt::format(
      "{} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {}", observation_size,
      action_size, members, elites, fmt::join(hidden, "+"), static_cast<int>(initialization),
      learning_rate, batch_size, fmt::join(decay, "+"), decay_scale, bound_weight, max_log_var,
      min_log_var, bootstrap, scale_inputs, static_cast<int>(holdout_rule), holdout_fraction,
      holdout_max, min_improvement, patience_epochs, max_updates, seed, PrecisionName(precision));
}

// The hashes under which an ensemble is found again.
struct Hashes {
  std::string inputs;  // of version, options and data
  std::string key;     // of all this and the bits of the first update
};

Hashes HashesAfterFirstUpdate(const DynamicsData<float>& data, DynamicsEnsemble<float>& ensemble) {
  StreamHash hash;
  HashText(hash, fmt::format("{} training {}", ProjectVersion(), kTrainingRevision));
  HashText(hash, Describe(ensemble.options()));
  HashColumns(hash, data.observations);
  HashColumns(hash, data.actions);
  HashColumns(hash, data.targets);
  std::string inputs = hash.Hex();
  HashState(hash, ensemble);
  return {std::move(inputs), hash.Hex()};
}

// The key of an ensemble whose training began under the key `begun` and goes on where it would have
// begun under `here`. No first update gives this key, so that no other run takes its ensemble.
std::string KeyOfMoved(const std::string& begun, const std::string& here) {
  StreamHash hash;
  HashText(hash, begun);
  HashText(hash, here);
  return hash.Hex();
}

// --- Files ---

// A run's work on its ensemble, of all sessions.
struct Work {
  Hashes hashes;
  double seconds_before = 0;               // of earlier sessions
  Clock::time_point start = Clock::now();  // of this one
  double Seconds() const { return seconds_before + SecondsSince(start); }
};

std::string RunPath(const EnsembleFiles& files) { return files.run_folder + "/ensemble.h5"; }

std::string CacheFolder(const EnsembleFiles& files) { return files.cache_folder + "/ensembles"; }

std::string CachePath(const EnsembleFiles& files, const std::string& key) {
  return fmt::format("{}/{}.h5", CacheFolder(files), key);
}

std::string StateHash(DynamicsEnsemble<float>& ensemble) {
  StreamHash hash;
  HashState(hash, ensemble);
  return hash.Hex();
}

Status Save(const std::string& path, const Work& work, DynamicsEnsemble<float>& ensemble) {
  B4MRL_ASSIGN_OR_RETURN(CheckpointWriter writer, CheckpointWriter::Create(path));
  writer.Text("inputs", work.hashes.inputs);
  writer.Text("key", work.hashes.key);
  writer.Number("seconds", work.Seconds());
  writer.Text("state_hash", StateHash(ensemble));
  writer.State("ensemble", ensemble);
  return writer.Commit();
}

// Loads an ensemble from a file whose text `name`, "inputs" or "key", is `expected`, and returns
// its key and the seconds of work on it. An error leaves `ensemble` unchanged: the file is absent
// (kFailedPrecondition), damaged or another ensemble's.
Result<EnsembleTraining> Load(const std::string& path, const char* name,
                              const std::string& expected, DynamicsEnsemble<float>& ensemble) {
  std::error_code error;
  if (!fs::exists(path, error))
    return Status(StatusCode::kFailedPrecondition, path + " does not exist");
  B4MRL_ASSIGN_OR_RETURN(CheckpointReader reader, CheckpointReader::Open(path));
  const std::string found = reader.Text(name);
  EnsembleTraining training{.key = reader.Text("key")};
  training.seconds_before = reader.Number("seconds");
  B4MRL_RETURN_IF_ERROR(reader.status());
  if (found != expected) {
    return Status(StatusCode::kDataLoss, path + " is of other data, options or another version");
  }
  DynamicsEnsemble<float> loaded = ensemble;
  reader.StateInto("ensemble", loaded);
  const std::string state_hash = reader.Text("state_hash");
  B4MRL_RETURN_IF_ERROR(reader.status());
  if (state_hash != StateHash(loaded)) {
    return Status(StatusCode::kDataLoss, path + " is damaged: its hash is another one");
  }
  if (!loaded.CanGoOn()) {
    return Status(StatusCode::kDataLoss, path + " is damaged: its counters are out of range");
  }
  ensemble = std::move(loaded);
  return training;
}

bool IsThere(const Status& loaded) { return loaded.code() != StatusCode::kFailedPrecondition; }

// Removes the least recently used files until the remaining files fit into `bytes_max`.
void BoundCache(const std::string& folder, uint64_t bytes_max) {
  struct Kept {
    fs::path path;
    fs::file_time_type used;
    uint64_t bytes;
  };
  std::vector<Kept> kept;
  std::error_code error;
  uint64_t total = 0;
  for (fs::directory_iterator entry(folder, error), end; entry != end; entry.increment(error)) {
    std::error_code gone;  // set if another run removes the file meanwhile
    const Kept file{entry->path(), entry->last_write_time(gone), entry->file_size(gone)};
    if (gone || !entry->is_regular_file(gone)) continue;
    kept.push_back(file);
    total += file.bytes;
  }
  std::sort(kept.begin(), kept.end(), [](const Kept& a, const Kept& b) { return a.used < b.used; });
  for (const Kept& file : kept) {
    if (total <= bytes_max) return;
    fs::remove(file.path, error);
    total -= file.bytes;
  }
}

Status LoadFromCache(const std::string& key, const EnsembleFiles& files,
                     DynamicsEnsemble<float>& ensemble) {
  if (files.cache_folder.empty()) return Status(StatusCode::kFailedPrecondition, "nothing is kept");
  B4MRL_RETURN_IF_ERROR(Load(CachePath(files, key), "key", key, ensemble).status());
  // Marks the file as just used. A failure only means that the file may be removed too early.
  std::error_code ignored;
  fs::last_write_time(CachePath(files, key), fs::file_time_type::clock::now(), ignored);
  return Status();
}

void Keep(const Work& work, const EnsembleFiles& files, DynamicsEnsemble<float>& ensemble,
          Progress& progress) {
  const std::string path = CachePath(files, work.hashes.key);
  std::error_code error;
  if (files.cache_folder.empty() || fs::exists(path, error)) return;
  Status status = MakeFolder(CacheFolder(files));
  if (status.ok()) status = Save(path, work, ensemble);
  // To keep a file that the limit has no room for, all others would go, and then the file itself.
  if (status.ok() && fs::file_size(path, error) > files.cache_bytes_max && !error) {
    fs::remove(path, error);
    status =
        Status(StatusCode::kLimitExceeded,
               fmt::format("it alone has more than the cache's {} bytes", files.cache_bytes_max));
  }
  // kBusy is no failure: another run is writing the same ensemble.
  if (!status.ok() && status.code() != StatusCode::kBusy) {
    progress.Message(fmt::format("the ensemble is not kept for other runs: {}", status.message()));
  }
  BoundCache(CacheFolder(files), files.cache_bytes_max);
}

// --- Training ---

Status CheckFinite(const DynamicsProgress& state) {
  if (std::isfinite(state.train_loss)) return Status();
  return Status(
      StatusCode::kFailedPrecondition,
      fmt::format("the ensemble's loss became {} in epoch {}", state.train_loss, state.epoch));
}

// Squares of large errors can overflow where the loss, in which the variance divides them, does
// not. No weights are then ever kept, and the training would end with those that it began with.
Status CheckHoldout(const DynamicsProgress& state, const DynamicsEnsemble<float>& ensemble) {
  if (!state.epoch_ended || ensemble.HasKeptWeights()) return Status();
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("no member of the ensemble had a finite hold-out error by the end of "
                            "epoch {} (the first one's is {}): the held-out rows have observations "
                            "or rewards whose squared errors no float holds",
                            state.epoch, state.holdout_mse.front()));
}

// Loads the state that this run has saved or, if there is none, the cache's ensemble of the key
// `work.hashes.key`. `work` then has the key of what `ensemble` is, and the run's earlier seconds.
void TakeUp(Work& work, const EnsembleFiles& files, DynamicsEnsemble<float>& ensemble,
            Progress& progress) {
  std::string& key = work.hashes.key;
  const Result<EnsembleTraining> own = Load(RunPath(files), "inputs", work.hashes.inputs, ensemble);
  if (own.ok()) {
    work.seconds_before = own->seconds_before;
    const bool moved = own->key != key;
    if (moved) key = ensemble.trained() ? own->key : KeyOfMoved(own->key, key);
    if (ensemble.trained()) return;
    progress.Message(fmt::format("training of the ensemble goes on where it stopped{}",
                                 moved ? ", on another kind of processor or build" : ""));
    return;
  }
  const Status kept = LoadFromCache(key, files, ensemble);
  if (kept.ok()) {
    progress.Message(fmt::format("using the ensemble kept in {}", CachePath(files, key)));
    return;
  }
  if (IsThere(kept) && kept.code() != StatusCode::kIoError) {
    std::error_code ignored;  // a damaged file would keep the new ensemble out for ever
    fs::remove(CachePath(files, key), ignored);
  }
  for (const Status& refused : {own.status(), kept}) {
    if (!IsThere(refused)) continue;
    progress.Message(fmt::format("an ensemble is not taken up: {}", refused.message()));
  }
}

Status TrainOn(const Work& work, const DynamicsData<float>& data, const EnsembleFiles& files,
               DynamicsEnsemble<float>& ensemble, Progress& progress,
               const std::atomic<bool>& stop) {
  DynamicsProgress state = ensemble.Train(data, 0);
  int64_t saved_updates = state.updates;
  // It ends when the hold-out error stops getting better, as a rule long before its largest number.
  progress.Start("train ensemble", "updates", 0, static_cast<uint64_t>(state.updates));
  while (!state.finished && !stop) {
    state = ensemble.Train(data, kUpdatesPerCall);
    B4MRL_RETURN_IF_ERROR(CheckFinite(state));
    B4MRL_RETURN_IF_ERROR(CheckHoldout(state, ensemble));
    std::string note;
    if (state.epoch_ended) {
      const double best = *std::min_element(state.holdout_mse.begin(), state.holdout_mse.end());
      note = fmt::format("epoch {}, hold-out error {:.4f}", state.epoch, best);
    }
    progress.Update(static_cast<uint64_t>(state.updates), note);
    if (state.updates - saved_updates < kUpdatesPerSave) continue;
    B4MRL_RETURN_IF_ERROR(Save(RunPath(files), work, ensemble));
    saved_updates = state.updates;
  }
  progress.Finish();
  return Status();
}

}  // namespace

Result<EnsembleTraining> TrainEnsemble(const DynamicsData<float>& data, const EnsembleFiles& files,
                                       DynamicsEnsemble<float>& ensemble, Progress& progress,
                                       const std::atomic<bool>& stop) {
  Work work;
  B4MRL_RETURN_IF_ERROR(ensemble.StartTraining(data));
  B4MRL_RETURN_IF_ERROR(CheckFinite(ensemble.Train(data, 1)));
  work.hashes = HashesAfterFirstUpdate(data, ensemble);
  const std::string key_here = work.hashes.key;
  TakeUp(work, files, ensemble, progress);
  if (!ensemble.trained()) {
    B4MRL_RETURN_IF_ERROR(TrainOn(work, data, files, ensemble, progress, stop));
    const bool moved = work.hashes.key != key_here;
    if (ensemble.trained() && !moved) Keep(work, files, ensemble, progress);
  }
  // An ensemble from the cache is saved too: the cache may have lost it when this run is resumed.
  B4MRL_RETURN_IF_ERROR(Save(RunPath(files), work, ensemble));
  return EnsembleTraining{std::move(work.hashes.key), work.seconds_before};
}

Status LoadTrainedEnsemble(const std::string& key, const EnsembleFiles& files,
                           DynamicsEnsemble<float>& ensemble) {
  const Status own = Load(RunPath(files), "key", key, ensemble).status();
  const bool loaded = own.ok() || LoadFromCache(key, files, ensemble).ok();
  if (loaded && ensemble.trained()) return Status();
  return Status(StatusCode::kDataLoss,
                own.ok() ? RunPath(files) + " holds no trained ensemble" : own.message());
}

}  // namespace b4mrl

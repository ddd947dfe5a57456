// Microseconds until a client has 256 rows of HalfCheetah data (five columns), with and without
// batches requested ahead (credits), against a local gather of the same rows; and the rate at which
// 16 clients at once get them, against a bare ROUTER that sends the same bytes.
//
// The dataset is synthetic and has a million rows, as the paper's. Its content does not change the
// times, but its size in memory does.
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/ping_pong.h"
#include "data/columns/gather.h"
#include "data/columns/sampler.h"
#include "data/d4rl/dataset_file_writer.h"
#include "data/files/make_folder.h"
#include "proto/base/child_program.h"
#include "proto/base/clock.h"
#include "proto/base/limits.h"
#include "proto/base/rng.h"

namespace b4mrl::perf {
namespace {

constexpr uint32_t kRows = 256;
constexpr size_t kDatasetRows = 1'000'000;
constexpr size_t kEpisodeRows = 1000;
constexpr uint32_t kCredits = 4;
constexpr int kColdBatchesPerTurn = 500;
constexpr int kStreamBatchesPerTurn = 100;
constexpr double kConsumerSeconds = 0.005;
constexpr int kClients = 16;
constexpr int kBatchesPerClient = 100;  // in a turn

// The dataset's five columns in this process's memory.
struct LocalColumns {
  std::vector<float> observations, actions, rewards, next_observations;
  std::vector<uint8_t> terminals;
};

LocalColumns MakeColumns() {
  LocalColumns columns;
  columns.observations.resize(kDatasetRows * kCheetahObservationSize);
  columns.actions.resize(kDatasetRows * kCheetahActionSize);
  columns.rewards.resize(kDatasetRows);
  columns.terminals.resize(kDatasetRows);
  Rng rng(0, "perf-dataset");
  for (auto* column : {&columns.observations, &columns.actions, &columns.rewards}) {
    for (float& x : *column) x = static_cast<float>(rng.Uniform(-1, 1));
  }
  columns.next_observations.assign(columns.observations.begin() + kCheetahObservationSize,
                                   columns.observations.end());
  columns.next_observations.resize(columns.observations.size());
  return columns;
}

// Writes `columns` as FOLDER/HalfCheetah/perf.h5.
Status WriteDataset(const LocalColumns& columns, const std::string& folder) {
  B4MRL_RETURN_IF_ERROR(MakeFolder(folder + "/HalfCheetah"));
  std::vector<uint8_t> timeouts(kDatasetRows);
  for (size_t row = kEpisodeRows - 1; row < kDatasetRows; row += kEpisodeRows) timeouts[row] = 1;
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer,
                         DatasetWriter::Create(folder + "/HalfCheetah/perf.h5",
                                               {.observation_dimensions = kCheetahObservationSize,
                                                .action_dimensions = kCheetahActionSize,
                                                .compression_level = 0}));
  DatasetRows rows;
  rows.rows = kDatasetRows;
  rows.observations = columns.observations;
  rows.actions = columns.actions;
  rows.rewards = columns.rewards;
  rows.next_observations = columns.next_observations;
  rows.terminals = columns.terminals;
  rows.timeouts = timeouts;
  B4MRL_RETURN_IF_ERROR(writer.Append(rows));
  return writer.Commit();
}

// Gathers batch after batch into one buffer, as the daemon does into a reply.
class LocalGather {
 public:
  explicit LocalGather(const LocalColumns& columns) : rows_(kRows) {
    Add(columns.observations.data(), kCheetahObservationSize * sizeof(float));
    Add(columns.actions.data(), kCheetahActionSize * sizeof(float));
    Add(columns.rewards.data(), sizeof(float));
    Add(columns.next_observations.data(), kCheetahObservationSize * sizeof(float));
    Add(columns.terminals.data(), 1);
  }

  // Microseconds of one batch's gather; the draw of its row numbers is not part of the time.
  double Batch() {
    SampleRows(0, next_batch_++, kDatasetRows, rows_);
    const Clock::time_point start = Clock::now();
    GatherRows(columns_, rows_);
    return SecondsSince(start) * 1e6;
  }

 private:
  void Add(const void* source, size_t row_bytes) {
    buffers_.push_back(std::make_unique<std::byte[]>(kRows * row_bytes));
    columns_.push_back({static_cast<const std::byte*>(source), row_bytes, buffers_.back().get()});
  }

  std::vector<uint64_t> rows_;
  uint64_t next_batch_ = 0;
  std::vector<std::unique_ptr<std::byte[]>> buffers_;
  std::vector<GatherColumn> columns_;
};

void WorkFor(double seconds) {
  const Clock::time_point start = Clock::now();
  while (SecondsSince(start) < seconds) {
  }
}

// Median of `count` calls of a Result<double>() or double().
template <typename Call>
Result<double> MedianOf(int count, Call call) {
  std::vector<double> times;
  for (int i = 0; i < count; ++i) {
    B4MRL_ASSIGN_OR_RETURN(const double microseconds, Result<double>(call()));
    times.push_back(microseconds);
  }
  return Median(std::move(times));
}

// The bare server of replies as large as that to a request for one batch, and a first asker.
Result<std::unique_ptr<PingPong>> StartBareServer(RemoteDataset& dataset) {
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows sample, dataset.Sample(kRows, 0, 0));
  pb::Request request;
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_request_id(sample.reply->request_id);
  request.set_deadline_ms(limits::kDefaultDeadlineMs);
  request.mutable_sample()->set_fingerprint(dataset.fingerprint());
  request.mutable_sample()->set_rows(kRows);
  request.mutable_sample()->set_batches(1);
  return PingPong::Start("tcp://127.0.0.1:*", {request.ByteSizeLong(), 0},
                         {sample.reply->envelope.ByteSizeLong(), sample.reply->payload.size()});
}

Status MeasureCold(const Options& options, RemoteDataset& dataset, LocalGather& gather,
                   Reporter& reporter) {
  B4MRL_ASSIGN_OR_RETURN(const auto bare, StartBareServer(dataset));
  uint64_t batch = 0;
  const auto value = [&]() -> Result<double> {
    const Clock::time_point start = Clock::now();
    B4MRL_RETURN_IF_ERROR(dataset.Sample(kRows, 0, batch++).status());
    return SecondsSince(start) * 1e6;
  };
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          2 * options.turns, [&] { return MedianOf(kColdBatchesPerTurn, value); },
          [&]() -> Result<double> {
            B4MRL_ASSIGN_OR_RETURN(const double round_trip, MedianOf(kColdBatchesPerTurn, [&] {
                                     return bare->RoundTrip();
                                   }));
            B4MRL_ASSIGN_OR_RETURN(const double local,
                                   MedianOf(kColdBatchesPerTurn, [&] { return gather.Batch(); }));
            return round_trip + local;
          }));
  reporter.Report({"batch-cold", medians.value, "us", medians.limit,
                   "bare round trip with that reply + local gather of the same rows, p50", 1.5,
                   true});
  return Status();
}

Status MeasureStream(const Options& options, RemoteDataset& dataset, LocalGather& gather,
                     Reporter& reporter) {
  BatchStream stream = dataset.Stream(kRows, 0, 0, kCredits);
  const auto value = [&]() -> Result<double> {
    WorkFor(kConsumerSeconds);
    const Clock::time_point start = Clock::now();
    B4MRL_RETURN_IF_ERROR(stream.Next().status());
    return SecondsSince(start) * 1e6;
  };
  const auto limit = [&] {
    WorkFor(kConsumerSeconds);
    return gather.Batch();
  };
  B4MRL_ASSIGN_OR_RETURN(const Medians medians,
                         MeasureInTurns(
                             options.turns, [&] { return MedianOf(kStreamBatchesPerTurn, value); },
                             [&] { return MedianOf(kStreamBatchesPerTurn, limit); }));
  reporter.Report({"batch-stream", medians.value, "us", medians.limit,
                   "local gather of the same rows, p50; a consumer of 5 ms, 4 credits", 1.0, true});
  return Status();
}

// Batches a second that `ask[i]`, each on a thread of its own, get together. The calls of one
// thread come one after the other.
Result<double> RateTogether(const std::vector<std::function<Status()>>& ask) {
  std::vector<Status> results(ask.size());
  std::vector<std::thread> threads;
  const Clock::time_point start = Clock::now();
  for (size_t i = 0; i < ask.size(); ++i) {
    threads.emplace_back([&, i] {
      for (int n = 0; n < kBatchesPerClient && results[i].ok(); ++n) results[i] = ask[i]();
    });
  }
  for (std::thread& thread : threads) thread.join();
  const double seconds = SecondsSince(start);
  for (const Status& status : results) B4MRL_RETURN_IF_ERROR(status);
  return kBatchesPerClient * static_cast<double>(ask.size()) / seconds;
}

Status MeasureClients(const Options& options, const std::string& endpoint, RemoteDataset& dataset,
                      Reporter& reporter) {
  B4MRL_ASSIGN_OR_RETURN(const auto first, StartBareServer(dataset));
  std::vector<Client> clients;
  std::vector<RemoteDataset> datasets;
  std::vector<std::unique_ptr<PingPong>> askers;
  clients.reserve(kClients);  // a dataset refers to its client
  datasets.reserve(kClients);
  std::vector<std::function<Status()>> served, bare;
  for (int i = 0; i < kClients; ++i) {
    B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(endpoint));
    clients.push_back(std::move(client));
    B4MRL_ASSIGN_OR_RETURN(RemoteDataset opened, clients.back().OpenDataset("HalfCheetah/perf"));
    datasets.push_back(std::move(opened));
    B4MRL_ASSIGN_OR_RETURN(auto asker, PingPong::Join(*first));
    askers.push_back(std::move(asker));
    served.push_back([&from = datasets.back(), i, batch = uint64_t{0}]() mutable {
      return from.Sample(kRows, static_cast<uint64_t>(i), batch++).status();
    });
    bare.push_back([&from = *askers.back()] { return from.RoundTrip().status(); });
  }
  B4MRL_ASSIGN_OR_RETURN(const Medians medians,
                         MeasureInTurns(
                             2 * options.turns, [&] { return RateTogether(served); },
                             [&] { return RateTogether(bare); }));
  reporter.Report({"batch-clients", medians.value, "1/s", medians.limit,
                   "bare ROUTER with replies of that size; 16 clients at once", 0.7, false});
  return Status();
}

}  // namespace

Status MeasureBatch(const Options& options, Reporter& reporter) {
  if (!options.endpoint.empty()) {
    return Status(StatusCode::kUnsupported,
                  "batches are measured on a dataset that a private daemon serves: leave out "
                  "--endpoint");
  }
  B4MRL_ASSIGN_OR_RETURN(const std::string folder, MakeTemporaryFolder("b4mrl-perf"));
  const FolderRemover remover(folder);
  const LocalColumns columns = MakeColumns();
  B4MRL_RETURN_IF_ERROR(WriteDataset(columns, folder));
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon, Daemon::Open(options, {.data_folder = folder}));
  B4MRL_ASSIGN_OR_RETURN(RemoteDataset dataset, daemon.client().OpenDataset("HalfCheetah/perf"));
  LocalGather gather(columns);
  B4MRL_RETURN_IF_ERROR(MeasureCold(options, dataset, gather, reporter));
  B4MRL_RETURN_IF_ERROR(MeasureStream(options, dataset, gather, reporter));
  return MeasureClients(options, daemon.endpoint(), dataset, reporter);
}

}  // namespace b4mrl::perf

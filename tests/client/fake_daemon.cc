#include "tests/client/fake_daemon.h"

#include <algorithm>
#include <numeric>

namespace b4mrl {

void FakeDaemon::Answer(FakeServer& server, FakeCall& call) {
  pb::Reply reply;
  switch (call.request.payload_case()) {
    case pb::Request::kHello:
      reply.mutable_hello()->set_protocol_version(protocol_version);
      if (session_lease_ms > 0) {
        reply.mutable_hello()->mutable_limits()->set_session_lease_ms(session_lease_ms);
      }
      reply.mutable_hello()->mutable_dataset_port()->set_ipc(address().substr(6));
      return server.Reply(call, std::move(reply));
    case pb::Request::kCatalogue:
      reply.mutable_catalogue();  // without an entry
      return server.Reply(call, std::move(reply));
    case pb::Request::kOpen:
      return AnswerOpen(server, call);
    case pb::Request::kClose: {
      const std::lock_guard lock(mutex_);
      closed_tokens_.insert(call.request.session_token());
      reply.mutable_close();
      return server.Reply(call, std::move(reply));
    }
    case pb::Request::kStep:
    case pb::Request::kReset:
    case pb::Request::kRestore:
      return AnswerLanes(server, call);
    case pb::Request::kQuery:
      return AnswerQuery(server, call);
    case pb::Request::kOpenDataset: {
      pb::OpenDatasetReply* open = reply.mutable_open_dataset();
      open->set_fingerprint("f");
      open->mutable_info()->set_name(call.request.open_dataset().dataset() + "-v0");
      open->mutable_info()->set_columns_sha256("c");
      open->set_rows(dataset_rows);
      open->set_observation_size(kObservationSize);
      open->set_action_size(kActionSize);
      open->set_environment(dataset_environment);
      open->mutable_hidden_dimensions()->Assign(hidden_dimensions.begin(), hidden_dimensions.end());
      return server.Reply(call, std::move(reply));
    }
    case pb::Request::kDatasetStats:
      return AnswerDatasetStats(server, call);
    case pb::Request::kSample:
    case pb::Request::kRead:
      return AnswerDatasetRows(server, call);
    default:
      return server.ReplyError(call, Status(StatusCode::kUnsupported, "not played here"));
  }
}

void FakeDaemon::AnswerOpen(FakeServer& server, const FakeCall& call) {
  pb::Reply reply;
  pb::OpenReply* open = reply.mutable_open();
  const pb::OpenRequest& request = call.request.open();
  open->set_environment(request.environment());
  open->set_num_envs(request.num_envs());
  open->set_seed(request.seed());
  open->set_observation_dtype(request.observation_dtype());
  open->mutable_info()->set_name(request.environment());
  for (size_t i = 0; i < kObservationSize; ++i) {
    open->mutable_info()->mutable_observation()->add_dimensions();
  }
  for (size_t i = 0; i < kActionSize; ++i) open->mutable_info()->mutable_action()->add_dimensions();
  if (has_ports) open->mutable_port()->set_ipc(address().substr(6));
  open->MergeFrom(open_reply);
  num_envs_ = request.num_envs();
  server.Reply(call, std::move(reply));
}

// The observation of a lane is its number, three times; the reward its half.
void FakeDaemon::AnswerLanes(FakeServer& server, const FakeCall& call) {
  const std::vector<uint64_t> numbers = Elements<uint64_t>(call, "numbers");
  pb::Reply reply;
  ArrayLayout layout(reply.mutable_arrays());
  const size_t observations =
      layout.Add("observations", DType::kFloat32, {numbers.size(), kObservationSize});
  const bool step = call.request.has_step();
  const size_t rewards = step ? layout.Add("rewards", DType::kFloat64, {numbers.size()}) : 0;
  for (const char* flag : {"terminated", "truncated", "cause"}) {
    if (step) layout.Add(flag, DType::kUint8, {numbers.size()});
  }
  Frame payload = layout.Allocate();
  std::fill_n(payload.data(), payload.size(), std::byte{0});
  for (size_t i = 0; i < numbers.size(); ++i) {
    const std::span<float> row = ArrayAt<float>(
        payload, observations + i * kObservationSize * sizeof(float), kObservationSize);
    std::ranges::fill(row, static_cast<float>(numbers[i]));
    if (step) {
      ArrayAt<double>(payload, rewards, numbers.size())[i] = static_cast<double>(numbers[i]) / 2;
    }
  }
  server.Reply(call, std::move(reply), std::move(payload));
}

// The next observation of a row is its observation plus 1, its reward the row's number.
void FakeDaemon::AnswerQuery(FakeServer& server, const FakeCall& call) {
  const std::vector<float> observations = Elements<float>(call, "observations");
  const size_t rows = observations.size() / kObservationSize;
  pb::Reply reply;
  ArrayLayout layout(reply.mutable_arrays());
  const size_t next = layout.Add("next_observations", DType::kFloat32, {rows, kObservationSize});
  const size_t rewards = layout.Add("rewards", DType::kFloat64, {rows});
  const size_t terminated = layout.Add("terminated", DType::kUint8, {rows});
  const size_t valid = layout.Add("valid", DType::kUint8, {rows});
  Frame payload = layout.Allocate();
  std::ranges::transform(observations, ArrayAt<float>(payload, next, observations.size()).begin(),
                         [](float x) { return x + 1; });
  const std::span<double> row_numbers = ArrayAt<double>(payload, rewards, rows);
  std::iota(row_numbers.begin(), row_numbers.end(),
            static_cast<double>(call.request.query().first_row()));
  std::ranges::fill(ArrayAt<uint8_t>(payload, terminated, rows), uint8_t{0});
  std::ranges::fill(ArrayAt<uint8_t>(payload, valid, rows), uint8_t{1});
  server.Reply(call, std::move(reply), std::move(payload));
}

// Observations as they are after normalisation; no whole episode.
void FakeDaemon::AnswerDatasetStats(FakeServer& server, const FakeCall& call) {
  pb::Reply reply;
  reply.mutable_dataset_stats();
  ArrayLayout layout(reply.mutable_arrays());
  const size_t mean = layout.Add("observation_mean", DType::kFloat64, {kObservationSize});
  const size_t std = layout.Add("observation_std", DType::kFloat64, {kObservationSize});
  Frame payload = layout.Allocate();
  std::ranges::fill(ArrayAt<double>(payload, mean, kObservationSize), 0.0);
  std::ranges::fill(ArrayAt<double>(payload, std, kObservationSize), 1.0);
  server.Reply(call, std::move(reply), std::move(payload));
}

// Every number in batch b of a Sample is b, in row i of a Read i.
void FakeDaemon::AnswerDatasetRows(FakeServer& server, const FakeCall& call) {
  const auto row_full_of = [](uint64_t number) {
    const auto value = static_cast<float>(number);
    return FakeRow{value, value, value, value};
  };
  if (call.request.has_sample()) {
    const pb::SampleRequest& sample = call.request.sample();
    return AnswerRows(server, call, RowsOf(sample), [&](uint64_t row) {
      return row_full_of(sample.first_batch() + row / sample.rows());
    });
  }
  const pb::ReadRequest& read = call.request.read();
  const uint64_t left = dataset_rows - std::min(read.first_row(), dataset_rows);
  AnswerRows(server, call, std::min<uint64_t>(read.rows(), left),
             [&](uint64_t row) { return row_full_of(read.first_row() + row); });
}

uint64_t FakeDaemon::RowsOf(const pb::SampleRequest& sample) {
  return uint64_t{sample.rows()} * std::max(sample.batches(), 1u);
}

void FakeDaemon::AnswerRows(FakeServer& server, const FakeCall& call, uint64_t rows,
                            const std::function<FakeRow(uint64_t)>& row) {
  pb::Reply reply;
  ArrayLayout layout(reply.mutable_arrays());
  struct Column {
    size_t offset;
    size_t width;
    float FakeRow::*value;
  };
  const size_t o = kObservationSize, a = kActionSize;
  const Column columns[] = {
      {layout.Add("observations", DType::kFloat32, {rows, o}), o, &FakeRow::observation},
      {layout.Add("actions", DType::kFloat32, {rows, a}), a, &FakeRow::action},
      {layout.Add("rewards", DType::kFloat32, {rows}), 1, &FakeRow::reward},
      {layout.Add("next_observations", DType::kFloat32, {rows, o}), o, &FakeRow::next_observation}};
  const size_t terminals = layout.Add("terminals", DType::kUint8, {rows});
  Frame payload = layout.Allocate();
  for (const auto& [offset, width, value] : columns) {
    const std::span<float> values = ArrayAt<float>(payload, offset, rows * width);
    for (size_t i = 0; i < values.size(); ++i) values[i] = row(i / width).*value;
  }
  std::ranges::fill(ArrayAt<uint8_t>(payload, terminals, rows), uint8_t{0});
  server.Reply(call, std::move(reply), std::move(payload));
}

}  // namespace b4mrl

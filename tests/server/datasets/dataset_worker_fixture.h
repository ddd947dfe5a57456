// A dataset worker on a thread of the test's process, a client for it, and a data folder.
#pragma once

#include <catch2/catch.hpp>
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "proto/base/limits.h"
#include "proto/base/spec.h"
#include "proto/wire/named_arguments.h"
#include "server/datasets/dataset_worker.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

inline constexpr int64_t kPatienceMs = 60'000;

// A worker and a client.
class Daemon {
 public:
  explicit Daemon(const std::string& data_folder,
                  const std::string& importer = B4MRL_BINARY_DIR "/b4mrl-serve") {
    ChildOptions child;
    child.memory_mib = 4096;
    child.role = "dataset-worker";
    child.data_folder = data_folder;
    child.cache_mib = limits::kDefaultCacheMib;
    child.endpoints = {{"ipc://" + folder_.File("socket")}};
    Result<SharedState> state = SharedState::Create(1, limits::kLoopbackLeaseMs);
    REQUIRE(state.ok());
    child_.emplace(std::move(child), std::move(*state));
    options_.importer_program = importer;
    Start();
  }
  ~Daemon() { Stop(); }

  void Start() {
    child_->shared().header().draining = false;
    thread_ = std::thread([this] { status = RunDatasetWorker(*child_, options_); });
  }
  void Stop() {
    child_->shared().header().draining = true;
    if (thread_.joinable()) thread_.join();
  }

  struct Answer {
    pb::Reply reply;
    Frame payload;
    StatusCode code() const { return static_cast<StatusCode>(reply.status().code()); }
    ArrayReader arrays() const { return ArrayReader::Parse(reply.arrays(), payload).value(); }
    template <typename T>
    std::vector<T> Values(const char* name) const {
      const ArrayReader all = arrays();
      const TensorView* view = all.Find(name);
      REQUIRE(view != nullptr);
      REQUIRE(view->dtype == DTypeOf<T>());
      const auto span = view->As<T>();
      return {span.begin(), span.end()};
    }
  };

  Answer Receive(DealerSocket& socket) {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (!deadline.expired()) {
      if (std::optional<Message> message = socket.TryReceive()) {
        Answer answer;
        REQUIRE(ParseEnvelope(message->envelope, &answer.reply).ok());
        answer.payload = std::move(message->payload);
        return answer;
      }
      socket.Wait(deadline);
    }
    FAIL("no reply");
    return {};
  }
  DealerSocket Connect() {
    auto socket = DealerSocket::Connect(context_, child_->options().endpoints[0].address);
    REQUIRE(socket.ok());
    return std::move(*socket);
  }
  Answer Ask(pb::Request request) {
    if (!socket_) socket_.emplace(Connect());
    if (request.protocol_version() == 0) request.set_protocol_version(limits::kProtocolVersion);
    request.set_request_id(++last_id_);
    request.set_deadline_ms(kPatienceMs);
    REQUIRE(socket_->Send({SerializeEnvelope(request).value(), Frame()}).ok());
    Answer answer = Receive(*socket_);
    CHECK(answer.reply.request_id() == last_id_);
    return answer;
  }
  Answer Open(const std::string& name, const std::string& corruptions = "", uint64_t seed = 0,
              const std::string& rule = "") {
    pb::Request request;
    request.mutable_open_dataset()->set_dataset(name);
    AddNamedArguments(ParseNamedArguments(corruptions).value(),
                      request.mutable_open_dataset()->mutable_corruptions());
    request.mutable_open_dataset()->set_seed(seed);
    request.mutable_open_dataset()->set_transition_rule(rule);
    return Ask(request);
  }
  Answer Sample(const std::string& fingerprint, uint64_t seed, uint64_t batch, uint32_t rows,
                uint32_t batches = 1) {
    pb::Request request;
    pb::SampleRequest* sample = request.mutable_sample();
    sample->set_fingerprint(fingerprint);
    sample->set_seed(seed);
    sample->set_first_batch(batch);
    sample->set_batches(batches);
    sample->set_rows(rows);
    sample->set_with_indices(true);
    return Ask(request);
  }
  Answer Read(const std::string& fingerprint, uint64_t first, uint32_t rows) {
    pb::Request request;
    request.mutable_read()->set_fingerprint(fingerprint);
    request.mutable_read()->set_first_row(first);
    request.mutable_read()->set_rows(rows);
    return Ask(request);
  }

  SharedState& shared() { return child_->shared(); }
  // The worker's line in the child table.
  ChildRecord& record() { return child_->record(); }
  // What the worker returned; once it has stopped.
  Status status{StatusCode::kInternal, "it still runs"};

 private:
  TemporaryFolder folder_;
  DatasetWorkerOptions options_;
  std::optional<ChildContext> child_;
  Context context_;
  std::optional<DealerSocket> socket_;
  std::thread thread_;
  uint64_t last_id_ = 0;
};

// With one file, HalfCheetah/medium.
struct DataFolder {
  TemporaryFolder folder;
  ExampleDataset data = MakeExampleDataset({700, 300, 500}, 17, 6);
  DataFolder() {
    std::filesystem::create_directory(folder.File("HalfCheetah"));
    REQUIRE(WriteExample(folder.File("HalfCheetah/medium.h5"), data).ok());
  }
  // A program that imports for ever.
  std::string EndlessImporter() const { return ImporterThatHangsOn(""); }
  // The real one, but for files with `word` in their names.
  std::string ImporterThatHangsOn(const std::string& word) const {
    const std::string importer = folder.File("importer");
    WriteBytes(importer, "#!/bin/sh\ncase $4 in *" + word +
                             "*) exec sleep 1000 ;; esac\nexec '" B4MRL_BINARY_DIR
                             "/b4mrl-serve' \"$@\"\n");
    std::filesystem::permissions(importer, std::filesystem::perms::owner_all);
    return importer;
  }
};

}  // namespace b4mrl

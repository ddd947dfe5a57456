#include "tests/conformance/case_runner.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl::conformance {
namespace {

using Json = nlohmann::json;

// For everything that a case sends at once; the slowest asks for two seconds of simulation.
constexpr int64_t kPatienceMs = 60'000;

std::string SessionOf(const Json& step) { return step.value("session", "a"); }

}  // namespace

Status CaseRunner::Connect() {
  const Json steps = Json::parse(R"([{"to": "gateway", "request": {"hello": {}}, "label": "hi"}])");
  B4MRL_RETURN_IF_ERROR(RunSteps(steps));
  dataset_address_ = AddressOf(labels_.at("hi").envelope.hello().dataset_port());
  return Status();
}

Status CaseRunner::Run(const Json& json) {
  tokens_.clear();
  labels_.clear();
  workers_.clear();
  last_worker_.reset();
  const Status status = RunSteps(json.at("steps"));
  // What a failed case left open would answer the next one.
  if (!status.ok()) peers_.clear();
  awaited_.clear();
  CloseSessions();
  return status;
}

Status CaseRunner::RunSteps(const Json& steps) {
  for (size_t i = 0; i < steps.size(); ++i) {
    B4MRL_RETURN_IF_ERROR(SendStep(steps[i], i).WithContext(fmt::format("step {}", i + 1)));
    if (steps[i].value("later", false)) continue;
    B4MRL_RETURN_IF_ERROR(Receive().WithContext(fmt::format("step {}", i + 1)));
    B4MRL_RETURN_IF_ERROR(CheckReplies(steps));
  }
  return Status();
}

std::string CaseRunner::AddressOf(const pb::Port& port) const {
  if (endpoint_.starts_with("ipc://"))
    return port.ipc().empty() ? endpoint_ : "ipc://" + port.ipc();
  if (port.tcp() == 0) return endpoint_;
  return fmt::format("{}:{}", endpoint_.substr(0, endpoint_.rfind(':')), port.tcp());
}

Result<Peer*> CaseRunner::PeerAt(const std::string& address, const std::string& door) {
  std::unique_ptr<Peer>& peer = peers_[door.empty() ? address : door];
  if (peer == nullptr) {
    B4MRL_ASSIGN_OR_RETURN(Peer connected,
                           door.empty() ? Peer::AtSocket(context_, address) : Peer::AtDoor(door));
    peer = std::make_unique<Peer>(std::move(connected));
  }
  return peer.get();
}

Result<Peer*> CaseRunner::PeerFor(const Json& step, bool may_be_door) {
  const std::string to = step.value("to", "worker");
  if (to == "gateway") return PeerAt(endpoint_, "");
  if (to == "dataset") return PeerAt(dataset_address_, "");
  if (!last_worker_) return InvalidArgument("to", to, "a case that has opened a session");
  const auto worker = workers_.find(SessionOf(step));
  const pb::Port& port = worker == workers_.end() ? *last_worker_ : worker->second;
  return PeerAt(AddressOf(port), use_doors_ && may_be_door ? port.door() : "");
}

std::string CaseRunner::TokenFor(const Json& step) {
  if (step.contains("token")) return FromHex(step.at("token").get<std::string>());
  std::string& token = tokens_[SessionOf(step)];
  if (token.empty()) {
    token.resize(limits::kTokenBytes);
    (void)!getrandom(token.data(), token.size(), 0);
  }
  return token;
}

Status CaseRunner::SendStep(const Json& step, size_t index) {
  if (step.contains("raw")) {
    B4MRL_ASSIGN_OR_RETURN(const std::vector<std::string> frames, BuildRaw(step));
    B4MRL_ASSIGN_OR_RETURN(Peer * peer, PeerFor(step, Peer::FitsDoor(frames)));
    awaited_.push_back({step.value("id", uint64_t{0}), index, false, {}});
    return peer->SendFrames(frames);
  }
  B4MRL_ASSIGN_OR_RETURN(Peer * peer, PeerFor(step, true));
  for (int i = 0; i < step.value("times", 1); ++i) {
    const uint64_t id = next_id_++;
    B4MRL_ASSIGN_OR_RETURN(Message message, BuildRequest(step, TokenFor(step), id, labels_));
    awaited_.push_back({id, index, false, {}});
    B4MRL_RETURN_IF_ERROR(peer->Send(std::move(message)));
  }
  return Status();
}

void CaseRunner::Accept(Message message) {
  ReplyMessage reply = ReadReply(std::move(message));
  const uint64_t id = reply.envelope.request_id();
  const auto found = std::find_if(awaited_.begin(), awaited_.end(), [id](const Awaited& awaited) {
    return awaited.id == id && !awaited.arrived;
  });
  if (found == awaited_.end()) return;
  found->arrived = true;
  found->reply = std::move(reply);
}

Status CaseRunner::Receive() {
  const Deadline deadline = Deadline::AfterMs(kPatienceMs);
  const auto waits = [](const Awaited& awaited) { return !awaited.arrived; };
  while (std::any_of(awaited_.begin(), awaited_.end(), waits)) {
    if (deadline.expired()) {
      return {StatusCode::kDeadlineExceeded, fmt::format("no reply within {} ms", kPatienceMs)};
    }
    std::vector<void*> handles;
    for (const auto& [address, peer] : peers_) {
      if (peer->handle() != nullptr) handles.push_back(peer->handle());
    }
    const bool has_doors = handles.size() < peers_.size();
    WaitAnyReadable(handles, has_doors ? 1 : deadline.remaining_ms());
    for (const auto& [address, peer] : peers_) {
      while (std::optional<Message> message = peer->TryReceive()) Accept(std::move(*message));
    }
  }
  return Status();
}

Status CaseRunner::CheckReplies(const Json& steps) {
  std::map<size_t, std::vector<int>> codes;  // by step
  const std::vector<Awaited> arrived = std::exchange(awaited_, {});
  for (const Awaited& awaited : arrived) {
    const Json& step = steps[awaited.step];
    const pb::Reply& envelope = awaited.reply.envelope;
    codes[awaited.step].push_back(envelope.status().code());
    B4MRL_RETURN_IF_ERROR(CheckReply(step, awaited.reply, awaited.id, labels_)
                              .WithContext(fmt::format("step {}", awaited.step + 1)));
    if (step.contains("label")) labels_[step.at("label").get<std::string>()] = awaited.reply;
    if (!envelope.has_open()) continue;
    last_worker_ = workers_[SessionOf(step)] = envelope.open().port();
  }
  for (const auto& [index, got] : codes) {
    const Json expected = steps[index].value("expect", Json::object());
    if (!expected.contains("some")) continue;
    if (std::count(got.begin(), got.end(), expected.at("some").get<int>()) > 0) continue;
    return {StatusCode::kInternal,
            fmt::format("step {}: no reply has code {}", index + 1, expected.at("some").dump())};
  }
  return Status();
}

// Errors do not matter here: the sessions end with their lease, too.
void CaseRunner::CloseSessions() {
  Json steps = Json::array();
  for (const auto& [name, token] : tokens_) {
    steps.push_back({{"session", name}, {"request", {{"close", Json::object()}}}});
  }
  if (last_worker_) (void)RunSteps(steps);
}

}  // namespace b4mrl::conformance

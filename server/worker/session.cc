#include "server/worker/session.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>

#include "proto/base/limits.h"
#include "proto/wire/named_arguments.h"
#include "server/environments/mujoco/compiled_model.h"
#include "server/shared_memory/open_record.h"

namespace b4mrl {
namespace {

SimulatorRequest SimulatorOf(const pb::OpenRequest& request) {
  SimulatorRequest simulator;
  simulator.environment = request.environment();
  simulator.perturbations = NamedArgumentsOf(request.perturbations());
  simulator.config = request.config();
  if (!request.compiled_model().empty()) {
    simulator.compiled_model = CompiledModelAt(request.compiled_model());
  }
  return simulator;
}

// Lane i gets seed + i, which must be a seed, too.
Status CheckSeeds(uint64_t seed, uint32_t lanes) {
  const uint64_t largest = UINT64_MAX - (std::max(lanes, 1u) - 1);
  if (seed <= largest) return Status();
  return InvalidArgument("seed", std::to_string(seed),
                         fmt::format("0..{} with {} lanes", largest, lanes));
}

Result<LaneStepper> OpenStepper(const SimulatorRequest& request, pb::AutoresetMode mode,
                                StartCheck check) {
  B4MRL_ASSIGN_OR_RETURN(std::shared_ptr<const Simulator> simulator, Simulator::Open(request));
  return LaneStepper::Create(std::move(simulator), static_cast<AutoresetMode>(mode), check);
}

}  // namespace

Result<LaneVerdict> JudgeLane(const LaneStatus& status, uint32_t lane, uint64_t number,
                              Operation operation) {
  if (status.busy != nullptr) {
    return Status(StatusCode::kBusy,
                  fmt::format("lane {} executes another request; one at a time", lane));
  }
  if (number == status.committed + 1) return LaneVerdict::kExecute;
  if (number != status.committed || number == 0) {
    const std::string last =
        status.committed == 0 ? "" : fmt::format(" or {} (last)", status.committed);
    return Status(number > status.committed ? StatusCode::kGap : StatusCode::kStale,
                  fmt::format("number of lane {} is {}, allowed: {} (next){}", lane, number,
                              status.committed + 1, last));
  }
  if (status.operation != operation) {
    return Status(StatusCode::kStale,
                  fmt::format("number {} of lane {} was {}, not {}", number, lane,
                              OperationName(status.operation), OperationName(operation)));
  }
  return LaneVerdict::kAnswerFromSlot;
}

Result<std::unique_ptr<Session>> Session::Build(SharedState& shared, uint32_t index,
                                                uint64_t generation) {
  const SessionRecord& record = shared.session(index);
  B4MRL_ASSIGN_OR_RETURN(pb::OpenRequest request, OpenRequestOf(record));
  B4MRL_RETURN_IF_ERROR(CheckSeeds(request.seed(), request.num_envs()));
  SimulatorRequest simulator = SimulatorOf(request);
  // The process that built a live session has checked its start.
  const StartCheck check =
      record.state() == SessionState::kLive ? StartCheck::kSkipped : StartCheck::kDone;
  B4MRL_ASSIGN_OR_RETURN(LaneStepper stepper,
                         OpenStepper(simulator, request.autoreset_mode(), check));
  std::unique_ptr<Session> session(new Session(shared, index, std::move(stepper)));
  session->simulator_request_ = std::move(simulator);
  session->token_ = std::string(SessionToken(record));
  session->generation_ = generation;
  session->first_lane_ = record.first_lane.load();
  session->lanes_.resize(record.lane_count.load());
  session->observation_dtype_ =
      request.observation_dtype() == pb::FLOAT64 ? DType::kFloat64 : DType::kFloat32;
  session->request_ = std::move(request);
  session->NameExperiment();
  // The gateway may have given the record to another session while it was read.
  const SessionState state = session->state();
  if (state == SessionState::kOpening) {
    session->InitializeLanes();
  } else if (state == SessionState::kLive) {
    B4MRL_RETURN_IF_ERROR(session->AdoptLanes());
  } else {
    return Status(StatusCode::kSessionLost, "the session was given up meanwhile");
  }
  return session;
}

SessionState Session::state() const {
  const SessionState state = record().state();
  const bool is_its_own = record().generation.load(std::memory_order_relaxed) == generation_;
  return is_its_own ? state : SessionState::kFree;
}

void Session::InitializeLanes() {
  record().simulator_hash.store(simulator().identity_hash());
  for (uint32_t lane = 0; lane < lane_count(); ++lane) {
    LaneSlot memory = slot(lane);
    stepper_.Initialize(request_.seed() + lane,
                        LaneRecord(layout(), memory.initial_buffer().data()));
    memory.Initialize(generation_, layout().bytes());
  }
}

Status Session::AdoptLanes() {
  if (record().simulator_hash != simulator().identity_hash()) {
    return Status(StatusCode::kVersionMismatch,
                  "its simulator is not what it was: a model's file has changed");
  }
  for (uint32_t lane = 0; lane < lane_count(); ++lane) {
    const LaneSlot memory = slot(lane);
    const std::string context = fmt::format("lane {}", lane);
    Status status = memory.Verify(generation_, layout().bytes());
    if (status.ok()) status = CheckLaneRecord(layout(), memory.committed_record());
    if (!status.ok()) return status.WithContext(context);
    RefreshLane(lane);
  }
  return Status();
}

bool Session::AddClose(PendingClose close) {
  // A Close says nothing but its id and token, so its id alone tells a copy.
  const auto copy = std::ranges::find_if(pending_closes, [&](const PendingClose& waiting) {
    return waiting.from.request_id == close.from.request_id;
  });
  if (copy != pending_closes.end()) {
    *copy = std::move(close);
    return true;
  }
  if (pending_closes.size() >= limits::kMaxRequestsInFlight) return false;
  pending_closes.push_back(std::move(close));
  return true;
}

std::vector<Asker> Session::TakeLateCloses(Clock::time_point now, Clock::time_point* next) {
  std::vector<Asker> late;
  std::erase_if(pending_closes, [&](const PendingClose& close) {
    const bool is_late = close.deadline.at() <= now;
    if (is_late) late.push_back(close.from);
    if (!is_late) *next = std::min(*next, close.deadline.at());
    return is_late;
  });
  return late;
}

void Session::RefreshLane(uint32_t lane) {
  const LaneSlot memory = slot(lane);
  LaneStatus& status = lanes_[lane];
  status.committed = memory.committed();
  status.operation = memory.committed_operation();
  status.fresh = committed_record(lane).header().phase == LanePhase::kFresh;
}

void Session::NameExperiment() {
  const std::string text = fmt::format(
      "{}\nseed {} lanes {} mode {} dtype {}", simulator().identity(), request_.seed(),
      lane_count(), static_cast<int>(request_.autoreset_mode()), DTypeName(observation_dtype_));
  const XXH128_hash_t hash = XXH3_128bits(text.data(), text.size());
  experiment_id_ = fmt::format("{:016x}{:016x}", hash.high64, hash.low64);
}

}  // namespace b4mrl

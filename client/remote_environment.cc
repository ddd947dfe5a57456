#include "client/remote_environment.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "client/numbered_request.h"

namespace b4mrl {
namespace {

Status ReadStepColumns(const ReceivedReply& reply, uint64_t rows, StepOutcome* outcome) {
  B4MRL_ASSIGN_OR_RETURN(outcome->rewards, reply.Column<double>("rewards", {rows}));
  B4MRL_ASSIGN_OR_RETURN(outcome->terminated, reply.Column<uint8_t>("terminated", {rows}));
  B4MRL_ASSIGN_OR_RETURN(outcome->truncated, reply.Column<uint8_t>("truncated", {rows}));
  B4MRL_ASSIGN_OR_RETURN(outcome->causes, reply.Column<uint8_t>("cause", {rows}));
  return Status();
}

// Row-major (rows, columns); empty if the session reports no infos.
Result<std::span<const double>> ReadInfos(const ReceivedReply& reply, std::string_view name,
                                          uint64_t rows, uint64_t columns) {
  if (columns == 0) return std::span<const double>();
  return reply.Column<double>(name, {rows, columns});
}

Status ReadEndedEpisodes(const ReceivedReply& reply, uint64_t rows, const TensorView& observations,
                         StepOutcome* outcome) {
  const TensorView* final_lanes = reply.arrays.Find("final_lanes");
  if (final_lanes == nullptr) return Status();
  const uint64_t ended = final_lanes->rows();
  B4MRL_ASSIGN_OR_RETURN(outcome->final_lanes, reply.Column<uint32_t>("final_lanes", {ended}));
  for (const uint32_t lane : outcome->final_lanes) {
    if (lane >= rows) {
      return NotUnderstood(InvalidNumber("final_lanes", lane, fmt::format("0..{}", rows - 1)));
    }
  }
  B4MRL_ASSIGN_OR_RETURN(
      outcome->final_observations,
      reply.Require("final_observations", {observations.dtype}, {ended, observations.shape[1]}));
  B4MRL_ASSIGN_OR_RETURN(outcome->final_returns, reply.Column<double>("final_returns", {ended}));
  B4MRL_ASSIGN_OR_RETURN(outcome->final_lengths, reply.Column<uint32_t>("final_lengths", {ended}));
  return Status();
}

// The error of a request that was sent twice, or has no reply. kBusy and kLimitExceeded would say
// that nothing was executed, but they refuse one copy of the request.
Status WithoutOutcome(const Status& status) {
  if (status.code() != StatusCode::kBusy && status.code() != StatusCode::kLimitExceeded) {
    return status;
  }
  return Status(StatusCode::kUnavailable,
                fmt::format("one copy of the request was refused, another one may have been "
                            "executed: {}",
                            status.message()));
}

}  // namespace

RemoteEnvironment::RemoteEnvironment(Connection connection, pb::OpenReply in_force,
                                     EnvironmentSpec spec, int64_t deadline_ms)
    : connection_(new Connection(std::move(connection)), EndSession{.is_open = true}),
      in_force_(std::move(in_force)),
      spec_(std::move(spec)),
      deadline_ms_(deadline_ms),
      numbers_(in_force_.num_envs()) {}

void RemoteEnvironment::EndSession::operator()(Connection* connection) const {
  if (is_open) (void)connection->CloseSession();
  delete connection;
}

Status RemoteEnvironment::Close() {
  Status status = connection_->CloseSession(NewDeadline());
  if (status.ok()) connection_.get_deleter().is_open = false;  // else the destructor tries again
  under_way_.clear();
  numbers_ = LaneNumbers(num_envs());  // no lane is busy or lost: the session is closed, they say
  return status;
}

Result<StepOutcome> RemoteEnvironment::Reset(std::span<const uint32_t> lanes,
                                             std::span<const uint64_t> seeds) {
  const size_t count = numbers_.CountOf(lanes);
  if (!seeds.empty() && seeds.size() != count) {
    return InvalidNumber("number of seeds", static_cast<double>(seeds.size()),
                         fmt::format("{}, one a lane", count));
  }
  NumberedRequest request(*this, lanes);
  request.request().mutable_reset();
  if (!seeds.empty()) request.Add("seeds", seeds, {count});
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, request.Send());
  return ReceiveNumbered(id, /*is_step=*/false);
}

template <typename Scalar>
Result<uint64_t> RemoteEnvironment::SendActions(std::span<const Scalar> actions,
                                                std::span<const uint32_t> lanes) {
  const size_t count = numbers_.CountOf(lanes);
  if (actions.size() != count * spec_.action.size()) {
    return InvalidNumber("number of action values", static_cast<double>(actions.size()),
                         fmt::format("{} lanes x {}", count, spec_.action.size()));
  }
  NumberedRequest request(*this, lanes);
  request.request().mutable_step();
  request.Add("actions", actions, {count, spec_.action.size()});
  return request.Send();
}

Result<uint64_t> RemoteEnvironment::Send(std::span<const float> actions,
                                         std::span<const uint32_t> lanes) {
  return SendActions(actions, lanes);
}
Result<uint64_t> RemoteEnvironment::Send(std::span<const double> actions,
                                         std::span<const uint32_t> lanes) {
  return SendActions(actions, lanes);
}

Result<StepOutcome> RemoteEnvironment::Step(std::span<const float> actions,
                                            std::span<const uint32_t> lanes) {
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, SendActions(actions, lanes));
  return ReceiveNumbered(id, /*is_step=*/true);
}
Result<StepOutcome> RemoteEnvironment::Step(std::span<const double> actions,
                                            std::span<const uint32_t> lanes) {
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, SendActions(actions, lanes));
  return ReceiveNumbered(id, /*is_step=*/true);
}

Result<StepOutcome> RemoteEnvironment::Receive(uint64_t* answered_id) {
  std::vector<uint64_t> ids(under_way_.size());
  std::transform(under_way_.begin(), under_way_.end(), ids.begin(),
                 [](const UnderWay& entry) { return entry.id; });
  Delivery delivery = connection_->ReceiveAny(ids);
  if (answered_id != nullptr) *answered_id = delivery.id;
  return Finish(std::move(delivery), /*is_step=*/true);
}

Result<StepOutcome> RemoteEnvironment::ReceiveNumbered(uint64_t id, bool is_step) {
  return Finish(connection_->ReceiveAny(std::span(&id, 1)), is_step);
}

std::vector<RemoteEnvironment::UnderWay>::iterator RemoteEnvironment::FindUnderWay(uint64_t id) {
  return std::find_if(under_way_.begin(), under_way_.end(),
                      [id](const UnderWay& entry) { return entry.id == id; });
}

Result<StepOutcome> RemoteEnvironment::Finish(Delivery delivery, bool is_step) {
  const auto found = FindUnderWay(delivery.id);
  if (found == under_way_.end()) return delivery.reply.status();
  const auto end = [&](LaneNumbers::Outcome outcome) {
    numbers_.End(found->lanes, outcome);
    under_way_.erase(found);
  };
  if (delivery.kind == Delivery::Kind::kRefused) {
    end(OutcomeOfRefusal(delivery.reply.status()));
    return delivery.reply.status();
  }
  if (delivery.kind == Delivery::Kind::kNoAnswer) {
    end(LaneNumbers::Outcome::kUnknown);
    return WithoutOutcome(delivery.reply.status());
  }
  Result<StepOutcome> outcome =
      ReadOutcome(std::move(*delivery.reply), numbers_.CountOf(found->lanes), is_step);
  end(outcome.ok() ? LaneNumbers::Outcome::kExecuted : LaneNumbers::Outcome::kUnknown);
  return outcome;
}

Result<StepOutcome> RemoteEnvironment::ReadOutcome(ReceivedReply reply, uint64_t rows,
                                                   bool is_step) const {
  StepOutcome outcome;
  outcome.reply = std::move(reply);
  outcome.request_id = outcome.reply.request_id;
  outcome.timing = outcome.reply.envelope.timing();
  const ReceivedReply& columns = outcome.reply;
  const DType dtype = static_cast<DType>(in_force_.observation_dtype());
  B4MRL_ASSIGN_OR_RETURN(outcome.observations, columns.Require("observations", {dtype},
                                                               {rows, spec_.observation.size()}));
  if (columns.arrays.Has("digests")) {
    B4MRL_ASSIGN_OR_RETURN(outcome.digests, columns.Column<uint64_t>("digests", {rows}));
  }
  // The reply to a Restore has no infos.
  const size_t infos = in_force_.with_infos() && (is_step || columns.arrays.Has("infos"))
                           ? spec_.info_names.size()
                           : 0;
  B4MRL_ASSIGN_OR_RETURN(outcome.infos, ReadInfos(columns, "infos", rows, infos));
  if (!is_step) return outcome;
  B4MRL_RETURN_IF_ERROR(ReadStepColumns(columns, rows, &outcome));
  B4MRL_RETURN_IF_ERROR(ReadEndedEpisodes(columns, rows, outcome.observations, &outcome));
  B4MRL_ASSIGN_OR_RETURN(outcome.final_infos,
                         ReadInfos(columns, "final_infos", outcome.final_lanes.size(),
                                   outcome.final_lanes.empty() ? 0 : infos));
  return outcome;
}

}  // namespace b4mrl

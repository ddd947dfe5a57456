// Microseconds of one step of one lane, against a bare round trip of the same size and a bare step.
#include <unistd.h>

#include <functional>
#include <string>
#include <vector>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/bare_physics.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/ping_pong.h"
#include "benchmarks/performance/support/single_lane.h"
#include "proto/base/clock.h"
#include "proto/base/limits.h"

namespace b4mrl::perf {
namespace {

constexpr int kStepsPerTurn = 1000;
constexpr size_t kActionRows = 4096;

struct ExchangeSizes {
  FrameSizes request;
  FrameSizes reply;
};

// Frame sizes of a step's request, as the client sends it, and of its reply, as received.
ExchangeSizes SizesOf(const StepOutcome& outcome) {
  pb::Request request;
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_session_token(std::string(limits::kTokenBytes, 't'));
  request.set_request_id(outcome.request_id);
  request.set_deadline_ms(limits::kDefaultDeadlineMs);
  request.mutable_step();
  ArrayLayout layout(request.mutable_arrays());
  layout.Add("actions", DType::kFloat32, {1, kCheetahActionSize});
  layout.Add("numbers", DType::kUint64, {1});
  return {{request.ByteSizeLong(), layout.payload_bytes()},
          {outcome.reply.envelope.ByteSizeLong(), outcome.reply.payload.size()}};
}

std::string BareAddress(Transport transport) {
  if (transport == Transport::kTcp) return "tcp://127.0.0.1:*";
  return "ipc://@b4mrl-perf-" + std::to_string(getpid());  // an abstract name leaves no file
}

// Median time of a bare round trip followed by a bare step. Both are timed as one interval, because
// a step after a wait is slower than a step after a step: other work has been through the caches.
Result<double> MedianBareStep(PingPong& bare, const std::function<void()>& step) {
  std::vector<double> times;
  for (int i = 0; i < kStepsPerTurn; ++i) {
    const Clock::time_point start = Clock::now();
    B4MRL_RETURN_IF_ERROR(bare.RoundTrip().status());
    step();
    times.push_back(SecondsSince(start) * 1e6);
  }
  return Median(std::move(times));
}

Status MeasureTransport(const Options& options, Transport transport, Reporter& reporter) {
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon, Daemon::Open(options, {.transport = transport}));
  B4MRL_ASSIGN_OR_RETURN(SingleLane lane, SingleLane::Open(daemon.client()));
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, lane.Step());
  const ExchangeSizes sizes = SizesOf(outcome);
  B4MRL_ASSIGN_OR_RETURN(const auto bare,
                         PingPong::Start(BareAddress(transport), sizes.request, sizes.reply));
  B4MRL_ASSIGN_OR_RETURN(const auto physics, BarePhysics::Load(HalfCheetahTask()));
  const std::vector<double> bare_actions = AsDoubles(RandomActions(kActionRows));
  const std::function<void()> bare_step = physics->Stepper(bare_actions);
  B4MRL_ASSIGN_OR_RETURN(const Medians medians,
                         MeasureInTurns(
                             2 * options.turns, [&] { return lane.MedianStepTime(kStepsPerTurn); },
                             [&] { return MedianBareStep(*bare, bare_step); }));
  const bool tcp = transport == Transport::kTcp;
  reporter.Report({tcp ? "latency-tcp" : "latency-ipc", medians.value, "us", medians.limit,
                   "bare DEALER-ROUTER round trip of the same sizes, then a bare step, p50",
                   tcp ? 1.35 : 0, true});
  return Status();
}

}  // namespace

Status MeasureLatency(const Options& options, Reporter& reporter) {
  if (!options.endpoint.empty()) {
    const bool ipc = options.endpoint.starts_with("ipc://");
    return MeasureTransport(options, ipc ? Transport::kIpc : Transport::kTcp, reporter);
  }
  B4MRL_RETURN_IF_ERROR(MeasureTransport(options, Transport::kTcp, reporter));
  B4MRL_RETURN_IF_ERROR(MeasureTransport(options, Transport::kIpc, reporter));
  B4MRL_RETURN_IF_ERROR(MeasureLatencyOfDoor(options, reporter));
  return MeasureLatencyBesideQueries(options, reporter);
}

}  // namespace b4mrl::perf

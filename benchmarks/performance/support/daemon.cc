#include "benchmarks/performance/support/daemon.h"

#include <utility>

#include "client/interrupt.h"
#include "proto/base/cores.h"
#include "proto/base/limits.h"
#include "proto/base/rng.h"

namespace b4mrl::perf {

Result<Daemon> Daemon::Open(const Options& options, const DaemonSetup& setup) {
  Daemon daemon;
  std::string endpoint = options.endpoint;
  if (endpoint.empty()) {
    PrivateDaemonOptions start;
    start.tcp = setup.transport == Transport::kTcp;
    start.data_folder = setup.data_folder;
    start.niceness = setup.niceness;
    if (setup.transport != Transport::kDoor) start.arguments.push_back("--no-door");
    if (setup.pinned) start.arguments.push_back("--pin");
    B4MRL_ASSIGN_OR_RETURN(daemon.process_, PrivateDaemon::Start(start));
    endpoint = daemon.process_->endpoint();
  }
  std::optional<ScopedPin> pin;
  if (setup.pinned) pin.emplace(AvailableCores().front());
  B4MRL_ASSIGN_OR_RETURN(Client client,
                         Client::Connect(endpoint, limits::kDefaultDeadlineMs, &Interrupted()));
  daemon.client_ = std::make_unique<Client>(std::move(client));
  daemon.endpoint_ = endpoint;
  return daemon;
}

std::vector<float> RandomActions(size_t rows, size_t width, double bound) {
  std::vector<float> actions(rows * width);
  Rng rng(0, "perf-actions");
  for (float& action : actions) action = static_cast<float>(rng.Uniform(-bound, bound));
  return actions;
}

std::vector<double> AsDoubles(const std::vector<float>& values) {
  return {values.begin(), values.end()};
}

}  // namespace b4mrl::perf

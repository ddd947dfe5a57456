// The daemon under measurement: that of --endpoint, or a private daemon that ends with this object.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "benchmarks/performance/benchmarks.h"
#include "client/client.h"
#include "client/private_daemon.h"
#include "proto/base/status.h"

namespace b4mrl::perf {

// How clients of a private daemon reach it. Over tcp and ipc, the daemon has no local doors.
enum class Transport { kTcp, kIpc, kDoor };

struct DaemonSetup {
  Transport transport = Transport::kTcp;
  std::string data_folder;  // of a private daemon; "": the daemon's default
  // Pins a private daemon's threads to cores, and the input-output thread of the client's sockets
  // to the first core, which it shares with the first worker's socket thread.
  bool pinned = false;
  int niceness = 0;  // of a private daemon, as PrivateDaemonOptions has it
};

class Daemon {
 public:
  static Result<Daemon> Open(const Options& options, const DaemonSetup& setup);
  Client& client() { return *client_; }
  const std::string& endpoint() const { return endpoint_; }
  // The process group of a private daemon; 0 for the daemon of --endpoint.
  pid_t process_group() const { return process_ ? process_->process_id() : 0; }

 private:
  std::optional<PrivateDaemon> process_;  // outlives the client
  std::unique_ptr<Client> client_;
  std::string endpoint_;
};

// Sizes of HalfCheetah's actions and observations.
inline constexpr size_t kCheetahActionSize = 6;
inline constexpr size_t kCheetahObservationSize = 17;
// Random actions, uniform in +-bound, row-major: the same numbers at every call.
std::vector<float> RandomActions(size_t rows, size_t width = kCheetahActionSize, double bound = 1);
std::vector<double> AsDoubles(const std::vector<float>& values);

}  // namespace b4mrl::perf

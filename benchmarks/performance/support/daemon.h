// The daemon under measurement: the one that was named, or a private one that ends with this
// object.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "benchmarks/performance/benchmarks.h"
#include "client/client.h"
#include "client/private_daemon.h"
#include "proto/base/status.h"

namespace b4mrl::perf {

enum class Transport { kTcp, kIpc };

struct DaemonSetup {
  Transport transport = Transport::kTcp;
  std::string data_folder;  // of a private daemon; "": its default
  // Pins a private daemon's threads, and the thread that the client's sockets have for input and
  // output to the first core, which it shares with the first worker's socket thread.
  bool pinned = false;
  int niceness = 0;  // of a private daemon, as PrivateDaemonOptions has it
};

class Daemon {
 public:
  static Result<Daemon> Open(const Options& options, const DaemonSetup& setup);
  Client& client() { return *client_; }
  const std::string& endpoint() const { return endpoint_; }
  // Of a private daemon's processes; 0 for a daemon that was named.
  pid_t process_group() const { return process_ ? process_->process_id() : 0; }

 private:
  std::optional<PrivateDaemon> process_;  // outlives the client
  std::unique_ptr<Client> client_;
  std::string endpoint_;
};

// Uniform random actions for HalfCheetah, row-major; the same for everything that is measured.
inline constexpr size_t kCheetahActionSize = 6;
inline constexpr size_t kCheetahObservationSize = 17;
// Uniform in +-bound, row after row; the same at every call.
std::vector<float> RandomActions(size_t rows, size_t width = kCheetahActionSize, double bound = 1);
std::vector<double> AsDoubles(const std::vector<float>& values);

}  // namespace b4mrl::perf

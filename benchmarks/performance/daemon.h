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

class Daemon {
 public:
  // `data_folder` matters to a private daemon only; "" is its default.
  static Result<Daemon> Open(const Options& options, Transport transport,
                             const std::string& data_folder = "");
  Client& client() { return *client_; }

 private:
  std::optional<PrivateDaemon> process_;  // outlives the client
  std::unique_ptr<Client> client_;
};

// Uniform random actions for HalfCheetah, row-major; the same for everything that is measured.
inline constexpr size_t kCheetahActionSize = 6;
inline constexpr size_t kCheetahObservationSize = 17;
std::vector<float> RandomActions(size_t rows);
std::vector<double> AsDoubles(const std::vector<float>& values);

}  // namespace b4mrl::perf

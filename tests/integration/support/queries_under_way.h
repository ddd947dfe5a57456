// Long requests that a worker has begun: a daemon that drains owes their answers.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/client.h"

namespace b4mrl {

class QueriesUnderWay {
 public:
  // Sends so many rows of `environment` that a worker needs about half a second for them, and waits
  // until the worker with that role, of which `client` asks, has them all.
  QueriesUnderWay(Client& client, RemoteEnvironment& environment, const std::string& role);
  // Requires that each query is answered with simulated rows.
  void RequireAnswers();

 private:
  RemoteEnvironment& environment_;
  std::vector<uint64_t> ids_;
};

}  // namespace b4mrl

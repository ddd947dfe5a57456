// The daemon's listening sockets: made once by the supervisor, inherited by every generation of
// children, so that clients' connections wait in the backlog while a child is replaced.
//
// The gateway listens on the addresses of --bind. Environment worker i gets the port after the
// first tcp address's plus i, and the dataset worker the one after the last worker's, on every tcp
// host; all of them get free ports if that first port is 0. With ipc they get PATH.worker-i and
// PATH.dataset beside the first ipc PATH.
#pragma once

#include <string>
#include <vector>

#include "proto/base/status.h"
#include "server/child.h"

namespace b4mrl {

struct Listeners {
  std::vector<ListeningEndpoint> gateway;
  std::vector<std::vector<ListeningEndpoint>> workers;
  std::vector<ListeningEndpoint> dataset;
  // What clients are told.
  std::vector<ChildOptions::Port> worker_ports;
  ChildOptions::Port dataset_port;
  bool loopback_only = true;
};

// Malformed addresses are kInvalidArgument; addresses in use, missing folders and the like
// kIoError; hosts that other machines can reach, without `insecure`, kFailedPrecondition.
Result<Listeners> OpenListeners(const std::vector<std::string>& binds, uint32_t workers,
                                bool insecure);

// Where a process of this machine connects to reach a listener.
std::string LocalAddress(const ListeningEndpoint& endpoint);

// Removes the files of ipc sockets; the descriptors stay open.
void RemoveSocketFiles(const Listeners& listeners);

}  // namespace b4mrl

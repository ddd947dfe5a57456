// The daemon's listening sockets: made once by the supervisor, inherited by every generation of
// children, so that clients' connections wait in the backlog while a child is replaced.
//
// The gateway listens on the addresses of --bind. Environment worker i gets the port after the
// first tcp address's plus i, and the dataset worker the one after the last worker's, on every tcp
// host; all of them get free ports if that first port is 0. With ipc they get PATH.worker-i and
// PATH.dataset beside the first ipc PATH. With a single port they get nothing but such ipc sockets,
// in a private folder where --bind has no ipc PATH, and clients are not told of them.
#pragma once

#include <string>
#include <vector>

#include "proto/base/status.h"
#include "server/process/child.h"
#include "server/process/options.h"

namespace b4mrl {

struct Listeners {
  std::vector<ListeningEndpoint> gateway;
  std::vector<std::vector<ListeningEndpoint>> workers;
  std::vector<ListeningEndpoint> dataset;
  // What clients are told.
  std::vector<ChildOptions::Port> worker_ports;
  ChildOptions::Port dataset_port;
  bool loopback_only = true;
  std::string private_folder;  // of a single port's ipc sockets; "" if there is none
};

// Malformed addresses are kInvalidArgument; addresses in use, missing folders and the like
// kIoError; hosts that other machines can reach, without `insecure`, kFailedPrecondition.
Result<Listeners> OpenListeners(const ServeOptions& options);

// Where a process of this machine connects to reach a listener.
std::string LocalAddress(const ListeningEndpoint& endpoint);

// Removes the files of ipc sockets and the private folder; the descriptors stay open.
void RemoveSocketFiles(const Listeners& listeners);

}  // namespace b4mrl

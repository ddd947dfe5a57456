// The daemon's listening sockets: made once by the supervisor, inherited by every generation of
// children, so that clients' connections wait in the backlog while a child is replaced.
//
// The gateway listens on the addresses of --bind. Let P be the port of the first tcp address: on
// every tcp host, environment worker i listens on port P + 1 + i and the dataset worker on the port
// after the last worker's; if P is 0, they all get free ports. Beside the first ipc PATH they
// listen on PATH.worker-i and PATH.dataset. With --single-port, workers have only such ipc sockets,
// in a private folder if --bind names no ipc PATH, and clients are not told of them.
//
// Each environment worker also has a local door (proto/wire/door.h), under a name that no other
// daemon has. With --single-port or --no-door there are none.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

#include "proto/base/status.h"
#include "server/process/child.h"
#include "server/process/options.h"

namespace b4mrl {

// A file that a listening socket has, as it was bound. The system gives its inode to no other file
// while the socket is open.
struct SocketFile {
  std::string path;
  dev_t device = 0;
  ino_t inode = 0;
};

struct Listeners {
  std::vector<ListeningEndpoint> gateway;
  std::vector<std::vector<ListeningEndpoint>> workers;
  std::vector<ListeningEndpoint> dataset;
  std::vector<int> doors;  // the listening socket of each worker's local door; empty without doors
  // The ports that clients are told.
  std::vector<ChildOptions::Port> worker_ports;
  ChildOptions::Port dataset_port;
  bool loopback_only = true;
  std::vector<SocketFile> socket_files;
  // A folder that is the daemon's, and holds ipc sockets and `private_data` alone; "": none.
  std::string private_folder;
  std::string private_data;  // a folder in private_folder, which ends with it; "": none
};

// The file of an ipc socket that nobody listens on is replaced; two daemons that are started on one
// PATH at once do not replace each other's. Malformed addresses are kInvalidArgument; addresses in
// use, missing folders and other errors of the system kIoError; hosts that other machines can
// reach, without `insecure`, kFailedPrecondition.
Result<Listeners> OpenListeners(const ServeOptions& options);

// Where a process of this machine connects to reach a listener.
std::string LocalAddress(const ListeningEndpoint& endpoint);

// Removes the files of ipc sockets, but those that somebody has replaced meanwhile, the private
// data folder with all that it holds, and the private folder; the descriptors stay open.
void RemoveSocketFiles(const Listeners& listeners);

}  // namespace b4mrl

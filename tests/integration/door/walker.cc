// A client that steps on and on until it is killed, and says how far it is:
//
//   door_walker ENDPOINT SEED
//
// Its first line is the way that requests go ("door", "tcp"). Each further line has a number of
// steps that all lanes have finished and the hash of what they brought. What the client library
// reports comes as a line "report: ...".
#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>

#include "client/client.h"
#include "tests/integration/support/lane_walk.h"

namespace b4mrl {
namespace {

void Say(const std::string& line) {
  const std::string text = line + "\n";
  // A line is written as a whole or not at all, whenever this process is killed.
  if (write(STDOUT_FILENO, text.data(), text.size()) != static_cast<ssize_t>(text.size())) _exit(1);
}

Status Walk(const std::string& endpoint, uint64_t seed) {
  B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(endpoint));
  client.set_reporter([](const std::string& text) { Say("report: " + text); });
  B4MRL_ASSIGN_OR_RETURN(LaneWalk walk, LaneWalk::Open(client, 2, 2, seed));
  Say(std::string(walk.environment().transport()));
  B4MRL_RETURN_IF_ERROR(walk.Reset());
  for (uint64_t said = 0; true;) {
    B4MRL_RETURN_IF_ERROR(walk.Advance());
    if (walk.FinishedSteps() == said) continue;
    said = walk.FinishedSteps();
    Say(fmt::format("{} {}", said, walk.Hash(said)));
  }
}

}  // namespace
}  // namespace b4mrl

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const b4mrl::Status status = b4mrl::Walk(argv[1], std::strtoull(argv[2], nullptr, 10));
  fmt::print(stderr, "door_walker: {}\n", status.ToString());
  return 1;
}

// Steps HalfCheetah with doubled gravity in a running daemon: first_steps tcp://127.0.0.1:7700
#include <fmt/format.h>

#include <vector>

#include "client/client.h"

int main(int argc, char** argv) {
  auto client = b4mrl::Client::Connect(argc > 1 ? argv[1] : "tcp://127.0.0.1:7700");
  if (!client.ok()) return fmt::print(stderr, "{}\n", client.status().ToString()), 1;
  auto env =
      client->Make("HalfCheetah", {.simulator = {{"gravity", "2"}}, .num_envs = 8, .seed = 1});
  if (!env.ok()) return fmt::print(stderr, "{}\n", env.status().ToString()), 1;
  double total = 0;
  auto outcome = env->Reset();
  for (int step = 0; step < 1000 && outcome.ok(); ++step) {
    const std::vector<float> actions(8 * env->spec().action.size(), 0.1f);
    outcome = env->Step(actions);
    if (outcome.ok()) total += outcome->rewards[0];
  }
  if (!outcome.ok()) return fmt::print(stderr, "{}\n", outcome.status().ToString()), 1;
  fmt::print("return of the first lane: {}\n", total);
}

// A session at a daemon that a test plays. For tests.
#pragma once

#include <catch2/catch.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "client/client.h"
#include "client/remote_environment.h"
#include "tests/client/fake_daemon.h"

namespace b4mrl {

class FakeSession {
 public:
  explicit FakeSession(FakeDaemon& daemon, EnvironmentOptions options = {.num_envs = 2}) {
    Result<Client> client = Client::Connect(daemon.address());
    REQUIRE(client.ok());
    client_.emplace(std::move(*client));
    Result<RemoteEnvironment> environment = client_->Make("Fake", options);
    INFO(environment.status().ToString());
    REQUIRE(environment.ok());
    environment_.emplace(std::move(*environment));
  }
  RemoteEnvironment* operator->() { return &*environment_; }

 private:
  std::optional<Client> client_;
  std::optional<RemoteEnvironment> environment_;
};
inline const std::vector<float> kOneAction(kActionSize, 0.5f);
inline const std::vector<float> kTwoActions(2 * kActionSize, 0.5f);
}  // namespace b4mrl

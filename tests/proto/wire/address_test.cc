#include <catch2/catch.hpp>

#include "proto/wire/socket.h"

namespace b4mrl {
namespace {

TEST_CASE("Addresses of tcp have a host and a port") {
  const Result<TcpAddress> address = ParseTcpAddress("tcp://127.0.0.1:7700");
  REQUIRE(address.ok());
  REQUIRE(address->host == "127.0.0.1");
  REQUIRE(address->port == 7700);
  for (const char* text :
       {"", "tcp://", "tcp://:", "tcp://:7700", "tcp://host", "tcp://host:", "tcp://host:65536",
        "tcp://host:-1", "tcp://host:http", "udp://host:1", "host:7700", "ipc:///tmp/x"}) {
    CAPTURE(text);
    REQUIRE(ParseTcpAddress(text).status().code() == StatusCode::kInvalidArgument);
  }
}

TEST_CASE("Paths of ipc fit the system's structure for them") {
  REQUIRE(*ParseIpcAddress("ipc:///run/b4mrl.sock") == "/run/b4mrl.sock");
  REQUIRE(ParseIpcAddress("ipc://" + std::string(107, 'x')).ok());
  REQUIRE_FALSE(ParseIpcAddress("ipc://" + std::string(108, 'x')).ok());
  REQUIRE_FALSE(ParseIpcAddress("ipc://").ok());
  REQUIRE_FALSE(ParseIpcAddress("tcp://127.0.0.1:1").ok());
}

TEST_CASE("Sockets refuse addresses that cannot be, and ports that are taken") {
  Context context;
  REQUIRE_FALSE(DealerSocket::Connect(context, "carrier-pigeon://roof").ok());
  REQUIRE_FALSE(DealerSocket::Connect(context, "").ok());
  const ListeningEndpoint nonsense{"tcp://not an address", -1};
  REQUIRE(RouterSocket::Bind(context, {&nonsense, 1}).status().code() == StatusCode::kIoError);
}

}  // namespace
}  // namespace b4mrl

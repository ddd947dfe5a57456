// The client's catalogue, put together from the pages of a server.
#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "client/client.h"
#include "tests/client/fake_daemon.h"

namespace b4mrl {
namespace {

// A daemon whose catalogue `fill` answers, page by page.
FakeDaemon::Hook Catalogue(std::function<void(uint32_t first, pb::CatalogueReply*)> fill) {
  return [fill = std::move(fill)](FakeServer& server, FakeCall& call) {
    if (!call.request.has_catalogue()) return false;
    pb::Reply reply;
    fill(call.request.catalogue().first(), reply.mutable_catalogue());
    server.Reply(call, std::move(reply));
    return true;
  };
}

TEST_CASE("The pages of a catalogue are put together in their order") {
  // Three environments and two perturbations, two a page.
  const FakeDaemon daemon(Catalogue([](uint32_t first, pb::CatalogueReply* page) {
    page->set_total(5);
    for (uint32_t i = first; i < std::min(first + 2, 5u); ++i) {
      std::string* name = i < 3 ? page->add_environments()->mutable_name()
                                : page->add_perturbations()->mutable_name();
      *name = std::to_string(i);
    }
  }));
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  const Result<pb::CatalogueReply> catalogue = client->Catalogue();
  REQUIRE(catalogue.ok());
  std::vector<std::string> names;
  for (const pb::EnvironmentInfo& info : catalogue->environments()) names.push_back(info.name());
  for (const pb::PerturbationInfo& info : catalogue->perturbations()) names.push_back(info.name());
  CHECK(names == std::vector<std::string>{"0", "1", "2", "3", "4"});
  CHECK(catalogue->environments_size() == 3);
}

TEST_CASE("A catalogue without a total, of an older server, is one page") {
  std::atomic<int> asked = 0;
  const FakeDaemon daemon(Catalogue([&](uint32_t, pb::CatalogueReply* page) {
    ++asked;
    page->add_environments()->set_name("Fake");
  }));
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  const Result<pb::CatalogueReply> catalogue = client->Catalogue();
  REQUIRE(catalogue.ok());
  CHECK(catalogue->environments_size() == 1);
  CHECK(asked == 1);
}

TEST_CASE("A catalogue that promises more entries than it has comes to an end") {
  const FakeDaemon daemon(Catalogue([](uint32_t first, pb::CatalogueReply* page) {
    page->set_total(9);
    if (first == 0) page->add_environments()->set_name("Fake");
  }));
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  const Result<pb::CatalogueReply> catalogue = client->Catalogue();
  REQUIRE(catalogue.ok());
  CHECK(catalogue->environments_size() == 1);
}

TEST_CASE("A catalogue without end is cut at the limit") {
  const FakeDaemon daemon(Catalogue([](uint32_t, pb::CatalogueReply* page) {
    page->set_total(UINT32_MAX);
    for (int i = 0; i < 1000; ++i) page->add_environments();
  }));
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  const Result<pb::CatalogueReply> catalogue = client->Catalogue();
  REQUIRE(catalogue.ok());
  const auto entries = static_cast<uint32_t>(catalogue->environments_size());
  CHECK(entries >= limits::kMaxCatalogueEntries);
  CHECK(entries < limits::kMaxCatalogueEntries + 1000);
}

TEST_CASE("A catalogue of long entries is given up at the limit of its bytes") {
  std::atomic<uint32_t> asked = 0;
  const FakeDaemon daemon(Catalogue([&](uint32_t, pb::CatalogueReply* page) {
    ++asked;
    page->set_total(UINT32_MAX);
    page->add_environments()->set_name(std::string(60'000, 'n'));
  }));
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  CHECK(client->Catalogue().status().code() == StatusCode::kInternal);
  CHECK(asked.load() < 300u);  // which take 17 MiB
}

TEST_CASE("A list of datasets with long entries is given up at the limit of its bytes") {
  const FakeDaemon daemon([](FakeServer& server, FakeCall& call) {
    if (!call.request.has_list_datasets()) return false;
    pb::Reply reply;
    reply.mutable_list_datasets()->set_total(UINT32_MAX);
    reply.mutable_list_datasets()->add_datasets()->set_name(std::string(60'000, 'n'));
    server.Reply(call, std::move(reply));
    return true;
  });
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  CHECK(client->ListDatasets().status().code() == StatusCode::kInternal);
}

}  // namespace
}  // namespace b4mrl

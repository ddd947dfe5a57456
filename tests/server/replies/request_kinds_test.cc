// The table of requests against the protocol's own list.
#include "server/replies/request_kinds.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("Every request of the protocol has one row that names its server") {
  const google::protobuf::OneofDescriptor* payload =
      pb::Request::descriptor()->FindOneofByName("payload");
  REQUIRE(payload != nullptr);
  for (int i = 0; i < payload->field_count(); ++i) {
    INFO(payload->field(i)->name());
    const auto number = static_cast<pb::Request::PayloadCase>(payload->field(i)->number());
    CHECK(std::ranges::count(kRequestKinds, number, &RequestKind::payload) == 1);
  }
  CHECK(std::size(kRequestKinds) == static_cast<size_t>(payload->field_count()));
  CHECK(FindRow(kRequestKinds, pb::Request::PAYLOAD_NOT_SET) == nullptr);
}

struct Handler {
  pb::Request::PayloadCase payload;
};

TEST_CASE("A server's handlers must be those of its requests, all of them and no other") {
  constexpr Handler kComplete[] = {{pb::Request::kOpen},
                                   {pb::Request::kLedger},
                                   {pb::Request::kServerStatus},
                                   {pb::Request::kCatalogue},
                                   {pb::Request::kHello}};
  constexpr Handler kOneLess[] = {{pb::Request::kOpen},
                                  {pb::Request::kServerStatus},
                                  {pb::Request::kCatalogue},
                                  {pb::Request::kHello}};
  constexpr Handler kOneMore[] = {{pb::Request::kOpen},         {pb::Request::kLedger},
                                  {pb::Request::kServerStatus}, {pb::Request::kCatalogue},
                                  {pb::Request::kHello},        {pb::Request::kStep}};
  STATIC_REQUIRE(HandlesAll(Server::kGateway, kComplete));
  STATIC_REQUIRE_FALSE(HandlesAll(Server::kGateway, kOneLess));
  STATIC_REQUIRE_FALSE(HandlesAll(Server::kGateway, kOneMore));
}

TEST_CASE("A refusal names what clients may ask its server for") {
  const Status gateway = NotAnswered(Server::kGateway);
  CHECK(gateway.code() == StatusCode::kUnsupported);
  CHECK(gateway.message() == "the gateway answers Hello, Catalogue, ServerStatus, Open, Ledger");
  const Status worker = NotAnswered(Server::kWorker);
  CHECK(worker.message() ==
        "an environment worker answers Step, Reset, Query, Snapshot, Restore, Render, Close; "
        "connect to the gateway's address for the others");
  const Status datasets = NotAnswered(Server::kDatasetWorker);
  CHECK(datasets.message() ==
        "the dataset worker answers ListDatasets, OpenDataset, DatasetStats, Sample, Read; "
        "connect to the gateway's address for the others");
}

}  // namespace
}  // namespace b4mrl

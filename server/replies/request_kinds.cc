#include "server/replies/request_kinds.h"

#include <fmt/format.h>

#include <string>
#include <string_view>

namespace b4mrl {
namespace {

std::string_view NameOf(Server server) {
  switch (server) {
    case Server::kGateway:
      return "the gateway";
    case Server::kWorker:
      return "an environment worker";
    case Server::kDatasetWorker:
      return "the dataset worker";
  }
  return "this server";
}

// "ListDatasets", of message ListDatasetsRequest.
std::string NameOf(pb::Request::PayloadCase payload) {
  std::string name = pb::Request::descriptor()->FindFieldByNumber(payload)->message_type()->name();
  return name.substr(0, name.rfind("Request"));
}

}  // namespace

Status NotAnswered(Server server) {
  std::string names;
  for (const RequestKind& kind : kRequestKinds) {
    if (kind.server != server || !kind.from_clients) continue;
    names += (names.empty() ? "" : ", ") + NameOf(kind.payload);
  }
  const std::string_view advice =
      server == Server::kGateway ? "" : "; connect to the gateway's address for the others";
  return Status(StatusCode::kUnsupported,
                fmt::format("{} answers {}{}", NameOf(server), names, advice));
}

}  // namespace b4mrl

// The kept catalogue against a models folder that changes.
#include "server/gateway/catalogue.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <filesystem>

#include "proto/b4mrl.pb.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

pb::Reply Ask(Catalogue& catalogue, uint64_t id) {
  pb::Reply reply;
  const Result<Frame> envelope = catalogue.Envelope(id);
  REQUIRE(envelope.ok());
  REQUIRE(ParseEnvelope(*envelope, &reply).ok());
  CHECK(reply.request_id() == id);
  CHECK(reply.protocol_version() == 1);
  CHECK(reply.has_status());
  CHECK(reply.catalogue().environments_size() > 0);
  return reply;
}

std::vector<std::string> Models(const pb::Reply& reply) {
  for (const pb::PerturbationInfo& info : reply.catalogue().perturbations()) {
    if (info.name() == "model") return {info.files().begin(), info.files().end()};
  }
  return {};
}

TEST_CASE("The kept catalogue lists the models that are there now") {
  using Names = std::vector<std::string>;
  const TemporaryFolder folder;
  // A change long ago, after which the folder is not listed each time.
  const auto settle = [&] {
    const timespec times[2] = {{1'000'000'000, 0}, {1'000'000'000, 0}};
    REQUIRE(utimensat(AT_FDCWD, folder.path().c_str(), times, 0) == 0);
  };
  Catalogue catalogue(folder.path());
  CHECK(Models(Ask(catalogue, 1)).empty());
  WriteBytes(folder.File("a.xml"), "");
  CHECK(Models(Ask(catalogue, 2)) == Names{"a.xml"});
  WriteBytes(folder.File("b.xml"), "");  // perhaps within the same tick of the clock
  CHECK(Models(Ask(catalogue, 3)) == Names{"a.xml", "b.xml"});
  settle();
  CHECK(Models(Ask(catalogue, 4)) == Names{"a.xml", "b.xml"});
  std::filesystem::remove(folder.File("a.xml"));
  CHECK(Models(Ask(catalogue, 5)) == Names{"b.xml"});
}

TEST_CASE("A models folder that is not there yet is empty") {
  const TemporaryFolder folder;
  Catalogue catalogue(folder.File("models"));
  CHECK(Models(Ask(catalogue, 1)).empty());
  std::filesystem::create_directory(folder.File("models"));
  WriteBytes(folder.File("models/a.xml"), "");
  CHECK(Models(Ask(catalogue, 2)) == std::vector<std::string>{"a.xml"});
}

}  // namespace
}  // namespace b4mrl

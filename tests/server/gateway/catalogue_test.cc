// The pages of the catalogue, and the kept entries against a models folder that changes.
#include "server/gateway/catalogue.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>

#include "proto/wire/frame.h"
#include "server/environments/list.h"
#include "server/perturbations/list.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

// The page that begins with entry `first`, as it reaches a client, and the bytes of its envelope.
struct Page {
  pb::CatalogueReply entries;
  size_t bytes = 0;
  uint32_t size() const {
    return static_cast<uint32_t>(entries.environments_size() + entries.perturbations_size() +
                                 entries.benchmarks_size());
  }
};

Page Ask(Catalogue& catalogue, uint32_t first, bool with_benchmarks = false) {
  pb::CatalogueRequest request;
  request.set_first(first);
  request.set_with_benchmarks(with_benchmarks);
  pb::Reply filled, parsed;
  filled.set_protocol_version(limits::kProtocolVersion);
  filled.set_request_id(UINT64_MAX);
  filled.mutable_status();
  catalogue.FillPage(request, &filled);
  const Result<Frame> envelope = SerializeEnvelope(filled);
  REQUIRE(envelope.ok());
  REQUIRE(ParseEnvelope(*envelope, &parsed).ok());
  CHECK(parsed.request_id() == UINT64_MAX);
  CHECK(parsed.has_status());
  REQUIRE(parsed.has_catalogue());
  return {parsed.catalogue(), envelope->size()};
}

pb::CatalogueReply AskAll(Catalogue& catalogue, size_t page_bytes = limits::kMaxEnvelopeBytes,
                          int* pages = nullptr, bool with_benchmarks = false) {
  pb::CatalogueReply all;
  for (uint32_t known = 0; known == 0 || known < all.total();) {
    const Page page = Ask(catalogue, known, with_benchmarks);
    CHECK(page.bytes <= page_bytes);
    REQUIRE(page.size() > 0);
    known += page.size();
    all.MergeFrom(page.entries);
    if (pages != nullptr) ++*pages;
  }
  return all;
}

using Names = std::vector<std::string>;

Names Models(const pb::CatalogueReply& catalogue) {
  for (const pb::PerturbationInfo& info : catalogue.perturbations()) {
    if (info.name() == "model") return {info.files().begin(), info.files().end()};
  }
  return {};
}

Names EntriesOf(const pb::CatalogueReply& catalogue) {
  Names names;
  for (const pb::EnvironmentInfo& info : catalogue.environments()) names.push_back(info.name());
  for (const pb::PerturbationInfo& info : catalogue.perturbations()) names.push_back(info.name());
  return names;
}

Names AllEntries() {
  Names names;
  for (const EnvironmentEntry& entry : EnvironmentList()) names.emplace_back(entry.name);
  for (const PerturbationEntry& entry : PerturbationList()) names.emplace_back(entry.name);
  return names;
}

// Whether the catalogue comes to have these models: the folder of a busy machine may answer late.
bool ModelsSoon(Catalogue& catalogue, const Names& wanted) {
  const Deadline patience = Deadline::AfterMs(30'000);
  while (Models(AskAll(catalogue)) != wanted) {
    if (patience.expired()) return false;
  }
  return true;
}

TEST_CASE("The kept catalogue lists the models that are there now") {
  const TemporaryFolder folder;
  // A change long ago, after which the folder is not listed each time.
  const auto settle = [&] {
    const timespec times[2] = {{1'000'000'000, 0}, {1'000'000'000, 0}};
    REQUIRE(utimensat(AT_FDCWD, folder.path().c_str(), times, 0) == 0);
  };
  Catalogue catalogue(folder.path(), {});
  CHECK(Models(AskAll(catalogue)).empty());
  WriteBytes(folder.File("a.xml"), "");
  CHECK(ModelsSoon(catalogue, {"a.xml"}));
  WriteBytes(folder.File("b.xml"), "");  // perhaps within the same tick of the clock
  CHECK(ModelsSoon(catalogue, {"a.xml", "b.xml"}));
  settle();
  CHECK(ModelsSoon(catalogue, {"a.xml", "b.xml"}));
  std::filesystem::remove(folder.File("a.xml"));
  CHECK(ModelsSoon(catalogue, {"b.xml"}));
}

TEST_CASE("A models folder that is not there yet is empty") {
  const TemporaryFolder folder;
  Catalogue catalogue(folder.File("models"), {});
  CHECK(Models(AskAll(catalogue)).empty());
  std::filesystem::create_directory(folder.File("models"));
  WriteBytes(folder.File("models/a.xml"), "");
  CHECK(ModelsSoon(catalogue, {"a.xml"}));
}

TEST_CASE("A catalogue that is longer than an envelope is delivered whole, in pages") {
  const TemporaryFolder folder;
  Names files;
  for (uint32_t i = 0; i < limits::kMaxModelFiles; ++i) {
    // The longest name that a model may have.
    files.push_back(fmt::format("{:03}-{}.xml", i, std::string(92, 'x')));
    WriteBytes(folder.File(files.back()), "");
  }
  Catalogue catalogue(folder.path(), {});
  REQUIRE(ModelsSoon(catalogue, files));
  int pages = 0;
  const pb::CatalogueReply all = AskAll(catalogue, limits::kMaxEnvelopeBytes, &pages);
  CHECK(EntriesOf(all) == AllEntries());
  CHECK(Models(all) == files);
  CHECK(all.ByteSizeLong() > limits::kMaxEnvelopeBytes);
  CHECK(pages > 1);
}

TEST_CASE("Pages hold what fits them, whatever number they begin with") {
  const TemporaryFolder folder;
  constexpr size_t kPageBytes = 20'000;  // Humanoid's description has 17 KB
  Catalogue catalogue(folder.path(), {}, kPageBytes);
  const Names names = EntriesOf(AskAll(catalogue, kPageBytes));
  CHECK(names == AllEntries());
  for (uint32_t first = 0; first < names.size(); ++first) {
    const Page page = Ask(catalogue, first);
    CHECK(page.bytes <= kPageBytes);
    CHECK(page.entries.total() == names.size());
    const Names held = EntriesOf(page.entries);
    REQUIRE_FALSE(held.empty());
    CHECK(std::equal(held.begin(), held.end(), names.begin() + first));
  }
  CHECK(Ask(catalogue, static_cast<uint32_t>(names.size())).size() == 0);
  CHECK(Ask(catalogue, UINT32_MAX).size() == 0);
}

TEST_CASE("An entry that is longer than a page is left out, and all others are delivered") {
  const TemporaryFolder folder;
  constexpr size_t kPageBytes = 10'000;
  Catalogue catalogue(folder.path(), {}, kPageBytes);
  Names expected = AllEntries();
  std::erase(expected, "Humanoid");
  CHECK(EntriesOf(AskAll(catalogue, kPageBytes)) == expected);
}

TEST_CASE("Benchmarks are told to those who ask for them, whole, in pages") {
  const TemporaryFolder folder;
  const std::vector<Benchmark> benchmarks = Take(ReadSuites({DefaultSuitesFolder()}));
  Catalogue catalogue(folder.path(), [&] { return benchmarks; });
  CHECK(AskAll(catalogue).benchmarks().empty());
  int pages = 0;
  const pb::CatalogueReply all =
      AskAll(catalogue, limits::kMaxEnvelopeBytes, &pages, /*with_benchmarks=*/true);
  CHECK(EntriesOf(all) == AllEntries());
  REQUIRE(static_cast<size_t>(all.benchmarks_size()) == benchmarks.size());
  for (int i = 0; i < all.benchmarks_size(); ++i) {
    const pb::BenchmarkInfo& told = all.benchmarks(i);
    CHECK(told.name() == benchmarks[i].name);
    CHECK(told.dataset() == benchmarks[i].dataset);
    CHECK(told.paper_size() == static_cast<int>(benchmarks[i].paper.size()));
  }
}

TEST_CASE("The perturbations of the project's benchmarks exist and fit their environments") {
  for (const Benchmark& benchmark : Take(ReadSuites({DefaultSuitesFolder()}))) {
    CAPTURE(benchmark.name);
    const EnvironmentSpec spec = Take(DescribeEnvironment(benchmark.environment));
    for (const auto& [text, use] : {std::pair{&benchmark.simulator, PerturbationUse::kSimulator},
                                    std::pair{&benchmark.world, PerturbationUse::kSimulator},
                                    std::pair{&benchmark.corruption, PerturbationUse::kDataset}}) {
      const auto arguments = Take(ParseNamedArguments(*text));
      CHECK(MakePerturbations(arguments, spec, use).ok());
    }
  }
}

}  // namespace
}  // namespace b4mrl

// Files that cost their reader more than their writer, opened while others open theirs: a sparse
// file of 70 GiB, small compressed files that inflate to hundreds of MiB, and models whose trial
// takes as long as it may. Nobody waits for them, and nobody's cache goes for them.
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// Rows of zeros: about 200 times smaller than what they inflate to.
void WriteBomb(const std::string& path, uint64_t rows) {
  constexpr size_t kPiece = 16'384;
  const ExampleDataset zeros = [] {
    ExampleDataset made = MakeExampleDataset({kPiece}, 17, 6);
    for (auto* column :
         {&made.observations, &made.next_observations, &made.actions, &made.rewards}) {
      std::ranges::fill(*column, 0.0f);
    }
    return made;
  }();
  DatasetWriter writer = Take(DatasetWriter::Create(
      path, {.observation_dimensions = 17, .action_dimensions = 6, .compression_level = 9}));
  while (writer.rows() < rows) RequireOk(writer.Append(zeros.Rows()));
  RequireOk(writer.Commit());
}

// The HalfCheetah's model under another name, whose solver never finds its solution good enough and
// goes on for `iterations`.
void WriteModel(const std::string& path, const std::string& name, int iterations) {
  std::ifstream file(B4MRL_SOURCE_DIR "/data/models/half_cheetah.xml");
  std::string text(std::istreambuf_iterator<char>(file), {});
  const size_t option = text.find("<option ");
  REQUIRE(option != std::string::npos);
  text.insert(option, "<!-- " + name + " -->");
  if (iterations > 0) {
    text.insert(text.find("<option ") + 8,
                "iterations=\"" + std::to_string(iterations) + "\" tolerance=\"0\" ");
  }
  WriteBytes(path, text);
}

// A data folder with three datasets that are in the cache, and hostile ones that are not.
class Scene {
 public:
  Scene(int bombs, uint64_t bomb_rows, int slow_models = 0) {
    fs::create_directories(folder_.File("HalfCheetah"));
    for (int i = 0; i < 3; ++i) WriteSmall(Kept(i));
    WriteBytes(PathOf("HalfCheetah/sparse"), "");
    fs::resize_file(PathOf("HalfCheetah/sparse"), 70ull << 30);
    hostile_ = {"HalfCheetah/sparse"};
    for (int i = 0; i < bombs; ++i) {
      hostile_.push_back("HalfCheetah/bomb-" + std::to_string(i));
      WriteBomb(PathOf(hostile_.back()), bomb_rows);
    }
    fs::create_directories(folder_.File("models"));
    for (int i = 0; i < slow_models; ++i) {
      slow_models_.push_back("slow-" + std::to_string(i) + ".xml");
      WriteModel(folder_.File("models/" + slow_models_.back()), slow_models_.back(), 100'000);
    }
    daemon_ = std::make_unique<PrivateDaemon>(StartDaemon(
        {.data_folder = folder_.path(),
         .arguments = {"--workers", "1", "--threads", "1", "--models", folder_.File("models")}}));
    Client client = Connect(daemon_->endpoint());
    for (int i = 0; i < 3; ++i) kept_.insert(Take(client.OpenDataset(Kept(i))).fingerprint());
  }

  static std::string Kept(int i) { return "HalfCheetah/kept-" + std::to_string(i); }
  std::string PathOf(const std::string& name) const { return folder_.File(name + ".h5"); }
  void WriteSmall(const std::string& name) {  // about 336 kB; no two are equal
    RequireOk(WriteExample(PathOf(name), MakeExampleDataset({1000, 500 + ++written_}, 17, 6)));
  }
  // Every hostile file is asked for by a client of its own.
  void OpenHostile() {
    for (const std::string& model : slow_models_) {
      attackers_.emplace_back([this, model] {
        Result<Client> client = Client::Connect(daemon_->endpoint());
        if (client.ok()) (void)client->Make("HalfCheetah", {.simulator = {{"model", model}}});
      });
    }
    for (const std::string& name : hostile_) {
      attackers_.emplace_back([this, name] {
        Result<Client> client = Client::Connect(daemon_->endpoint());
        if (client.ok()) (void)client->OpenDataset(name);
      });
    }
  }
  void AwaitHostile() {
    for (std::thread& attacker : attackers_) attacker.join();
    attackers_.clear();
  }
  // How long a bystander's first opening of a small file takes.
  double SecondsOfSmallImport(const std::string& name) {
    WriteSmall(name);
    Client bystander = Connect(daemon_->endpoint());
    const Clock::time_point start = Clock::now();
    RequireOk(bystander.OpenDataset(name).status());
    return SecondsSince(start);
  }
  // How long a bystander waits for a session with a sound model that nobody has opened yet.
  double SecondsOfGoodModel(const std::string& name) {
    WriteModel(folder_.File("models/" + name), name, /*iterations=*/0);
    Client bystander = Connect(daemon_->endpoint());
    const Clock::time_point start = Clock::now();
    RequireOk(bystander.Make("HalfCheetah", {.simulator = {{"model", name}}}).status());
    return SecondsSince(start);
  }
  void RequireCaches() const {
    for (const std::string& fingerprint : kept_) {
      CAPTURE(fingerprint);
      REQUIRE(fs::exists(folder_.File(".b4mrl-cache/" + fingerprint + "/manifest.json")));
    }
  }
  bool HasCaches(size_t count) const {
    size_t found = 0;
    for (const auto& entry : fs::directory_iterator(folder_.File(".b4mrl-cache"))) {
      found += entry.path().filename().string().size() == 32 ? 1 : 0;
    }
    return found == count;
  }

 private:
  TemporaryFolder folder_;
  std::unique_ptr<PrivateDaemon> daemon_;
  std::set<std::string> kept_;
  std::vector<std::string> hostile_, slow_models_;
  std::vector<std::thread> attackers_;
  size_t written_ = 0;
};

TEST_CASE("A sparse file and a file that inflates cost other clients neither time nor caches") {
  Scene scene(/*bombs=*/1, /*bomb_rows=*/200'000);
  scene.OpenHostile();
  const double seconds = scene.SecondsOfSmallImport("HalfCheetah/small");
  scene.RequireCaches();
  // Hashing 70 GiB alone takes longer; this machine may be busy with other things.
  CHECK(seconds < 60);
  scene.AwaitHostile();
  scene.RequireCaches();
  CHECK(scene.HasCaches(5));  // the small one, and the inflated one: it is a sound dataset
}

TEST_CASE("Small imports and good models take 3 s at most beside large ones and slow ones",
          "[.][long]") {
  // Each inflates to 475 MiB; there are more of them than places, and of the models as well.
  Scene scene(/*bombs=*/8, /*bomb_rows=*/3'000'000, /*slow_models=*/6);
  scene.OpenHostile();
  double worst_import = 0, worst_model = 0;
  for (int i = 0; i < 10; ++i) {
    const std::string number = std::to_string(i);
    worst_import =
        std::max(worst_import, scene.SecondsOfSmallImport("HalfCheetah/small-" + number));
    worst_model = std::max(worst_model, scene.SecondsOfGoodModel("good-" + number + ".xml"));
    scene.RequireCaches();
  }
  WARN("of ten, the slowest import took " << worst_import << " s, the slowest model " << worst_model
                                          << " s");
  CHECK(worst_import < 3);
  CHECK(worst_model < 3);
  scene.AwaitHostile();
  scene.RequireCaches();
  CHECK(scene.HasCaches(3 + 10 + 1));  // eight equal files, one cache
}

}  // namespace
}  // namespace b4mrl

// Datasets go where the daemon looks for them, and what fails leaves nothing behind.
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>

#include "proto/base/folders.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/client/fake_daemon.h"
#include "tests/data/example_dataset.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

Words Make(const Words& more) {
  Words words = {"dataset", "make", "HalfCheetah/medium", "--rows", "1000", "--quiet"};
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

TEST_CASE("With an endpoint a dataset is made and imported where that daemon looks") {
  const TemporaryFolder folder;
  const PrivateDaemon daemon = StartDaemon({.data_folder = folder.path()});
  const Words environment = {"B4MRL_ENDPOINT=" + daemon.endpoint()};
  const Outcome made = Run(Make({}), environment);
  INFO(made.err);
  REQUIRE(made.exit_code == 0);
  CHECK(fs::exists(folder.File("HalfCheetah/medium-v0.h5")));
  CHECK_FALSE(fs::exists(UsersFolder() + "/data/HalfCheetah"));

  const Outcome imported = Run({"dataset", "import", folder.File("HalfCheetah/medium-v0.h5"),
                                "--name", "HalfCheetah/copy", "--endpoint", daemon.endpoint()});
  INFO(imported.err);
  CHECK(imported.exit_code == 0);
  const std::string list = Run({"list", "datasets"}, environment).out;
  CHECK(Says(list, "HalfCheetah/medium"));
  CHECK(Says(list, "HalfCheetah/copy"));
}

TEST_CASE("A data folder beside an endpoint is refused, for the daemon has its own") {
  const TemporaryFolder folder;
  const Outcome outcome =
      Run(Make({"--endpoint", "ipc://" + folder.File("nobody"), "--data", folder.File("data")}));
  CHECK(outcome.exit_code == 2);
  CHECK(Says(outcome.err, "--data"));
  CHECK(Says(outcome.err, "--endpoint"));
  CHECK_FALSE(fs::exists(folder.File("data")));
}

TEST_CASE("No dataset is written for a daemon whose data folder is not the one of that path here") {
  const TemporaryFolder folder;
  const FakeDaemon elsewhere([&](FakeServer& server, FakeCall& call) {
    if (!call.request.has_server_status()) return false;
    pb::Reply reply;
    reply.mutable_server_status()->set_data_folder(folder.path());
    reply.mutable_server_status()->set_data_folder_id(FolderIdentity(folder.path()) + 1);
    server.Reply(call, std::move(reply));
    return true;
  });
  const Outcome outcome = Run(Make({"--endpoint", elsewhere.address()}));
  CHECK(outcome.exit_code == 5);
  CHECK(Says(outcome.err, folder.path()));
  CHECK(fs::is_empty(folder.path()));
}

TEST_CASE("The copy of a file that is imported stays unless the daemon found fault with the file") {
  const auto [code, stays] = GENERATE(
      std::pair{StatusCode::kLimitExceeded, true}, std::pair{StatusCode::kDeadlineExceeded, true},
      std::pair{StatusCode::kDataLoss, false}, std::pair{StatusCode::kFailedPrecondition, false});
  const TemporaryFolder folder;
  fs::create_directory(folder.File("data"));
  WriteBytes(folder.File("file.h5"), "any");
  const FakeDaemon refusing([&, code = code](FakeServer& server, FakeCall& call) {
    pb::Reply reply;
    if (call.request.has_server_status()) {
      reply.mutable_server_status()->set_data_folder(folder.File("data"));
      reply.mutable_server_status()->set_data_folder_id(FolderIdentity(folder.File("data")));
    } else if (call.request.has_open_dataset()) {
      SetStatus(Status(code, "refused"), reply.mutable_status());
    } else {
      return false;
    }
    server.Reply(call, std::move(reply));
    return true;
  });
  const Outcome outcome = Run({"dataset", "import", folder.File("file.h5"), "--name", "zz/y",
                               "--endpoint", refusing.address()});
  CAPTURE(StatusCodeName(code), outcome.err);
  CHECK(outcome.exit_code == 3);
  CHECK(Says(outcome.err, "refused"));
  CHECK(Says(outcome.err, folder.File("data/zz/y.h5")) == stays);
  CHECK(fs::exists(folder.File("data/zz/y.h5")) == stays);
}

TEST_CASE("What cannot be imported is told by its own name and reason, and leaves no folder") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("bad.h5"), "no HDF5");
  fs::create_directory(folder.File("data"));
  const auto import = [&](const std::string& file) {
    return Run(
        {"dataset", "import", folder.File(file), "--name", "zz/y", "--data", folder.File("data")});
  };
  const Outcome bad = import("bad.h5");
  CHECK(bad.exit_code == 3);
  CHECK(Says(bad.err, folder.File("bad.h5")));
  CHECK(Says(bad.err, "not an HDF5 file"));
  CHECK_FALSE(Says(bad.err, "zz"));
  CHECK_FALSE(fs::exists(folder.File("data/zz")));

  const Outcome missing = import("none.h5");
  CHECK(missing.exit_code == 3);
  CHECK(Says(missing.err, "No such file"));
  CHECK_FALSE(fs::exists(folder.File("data/zz")));
}

TEST_CASE("A folder of D4RL's files is imported under D4RL's names, whatever else is in it") {
  const TemporaryFolder folder;
  const std::string files = folder.File("files"), data = folder.File("data");
  fs::create_directories(files);
  const ExampleDataset example = MakeExampleDataset({5, 7}, 17, 6);
  REQUIRE(WriteExample(files + "/halfcheetah_medium_replay-v2.hdf5", example).ok());
  REQUIRE(WriteExample(files + "/halfcheetah_mixed.hdf5", example).ok());
  REQUIRE(WriteExample(files + "/walker_mixed.hdf5", example).ok());
  WriteBytes(files + "/walker2d_random-v1.hdf5", "no HDF5");
  WriteBytes(files + "/maze2d-umaze-sparse-v1.hdf5", "of no known environment");
  WriteBytes(files + "/notes.txt", "no dataset");
  const auto import = [&] { return Run({"dataset", "import", "--d4rl", files, "--data", data}); };
  const Outcome first = import();
  CAPTURE(first.out, first.err);
  CHECK(first.exit_code == 3);
  CHECK(Says(first.out, "d4rl/halfcheetah-medium-replay-v2: "));
  CHECK(Says(first.out, "d4rl/halfcheetah-medium-replay-v0: "));
  CHECK(Says(first.out, "d4rl/walker2d-medium-replay-v0: "));
  CHECK(Says(first.err, "walker2d_random-v1.hdf5"));
  CHECK(Says(first.err, "1 of 4 files were not imported"));
  CHECK_FALSE(fs::exists(data + "/d4rl/walker2d-random-v1.hdf5"));
  CHECK_FALSE(Says(first.err, "maze2d"));

  fs::remove(files + "/walker2d_random-v1.hdf5");
  const Outcome again = import();
  CHECK(again.exit_code == 0);
  CHECK(again.out.empty());
  CHECK(Says(again.err, "d4rl/halfcheetah-medium-replay-v2: is there already"));
}

TEST_CASE("A name too long for a file is refused before a daemon is started") {
  const TemporaryFolder folder;
  const std::string longest = "mine/" + std::string(195, 'a');
  WriteBytes(folder.File("file.h5"), "no HDF5");
  const std::string agent = B4MRL_SOURCE_DIR "/data/agents/hopper-medium.h5";
  for (const std::string& name : {longest + "a", "mine/" + std::string(300, 'a')}) {
    for (const Words& words :
         {Words{"dataset", "make", name, "--agent", agent, "--rows", "100"},
          Words{"dataset", "import", folder.File("file.h5"), "--name", name}}) {
      Words all = words;
      all.insert(all.end(), {"--data", folder.File("data")});
      const Outcome outcome = Run(all);
      CAPTURE(outcome.err);
      CHECK(outcome.exit_code == 3);
      CHECK(Says(outcome.err, "200 characters at most"));
    }
  }
  CHECK_FALSE(fs::exists(folder.File("data")));
  const Outcome fits = Run({"dataset", "import", folder.File("file.h5"), "--name", longest,
                            "--data", folder.File("data")});
  CHECK(fits.exit_code == 3);
  CHECK(Says(fits.err, "not an HDF5 file"));
}

TEST_CASE("An import without a file, a name or a folder says what is missing") {
  const TemporaryFolder folder;
  CHECK(Run({"dataset", "import"}).exit_code == 2);
  CHECK(Run({"dataset", "import", "file.h5"}).exit_code == 2);
  CHECK(Run({"dataset", "import", "file.h5", "--name", "a/b", "--d4rl", "."}).exit_code == 2);
  const Outcome empty = Run({"dataset", "import", "--d4rl", folder.path()});
  CHECK(empty.exit_code == 3);
  CHECK(Says(empty.err, folder.path()));
}

}  // namespace
}  // namespace b4mrl

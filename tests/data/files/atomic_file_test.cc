#include "data/files/atomic_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <string>

#include "proto/base/unique_fd.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

TEST_CASE("What is read as a small file is a regular one, unless others may be") {
  const TemporaryFolder folder;
  const std::string pipe = folder.File("pipe");
  REQUIRE(mkfifo(pipe.c_str(), 0600) == 0);
  CHECK(ReadSmallFile(pipe, 100).status().code() == StatusCode::kIoError);  // and does not wait
  CHECK(ReadSmallFile(folder.path(), 100).status().code() == StatusCode::kIoError);
  CHECK(ReadSmallFile("/dev/null", 100).status().code() == StatusCode::kIoError);
  CHECK(ReadSmallFile("/dev/null", 100, FileKinds::kAny).value().empty());
}

TEST_CASE("A file in its place is not locked, even while a forked child has it open") {
  const TemporaryFolder folder;
  const std::string path = folder.File("manifest.json");
  Result<AtomicFile> file = AtomicFile::Create(path);
  REQUIRE(file.ok());
  std::array<int, 2> pipe_ends{};
  REQUIRE(pipe(pipe_ends.data()) == 0);
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {  // as between fork and exec, for as long as the pipe is open
    close(pipe_ends[1]);
    char byte = 0;
    while (read(pipe_ends[0], &byte, 1) > 0) {
    }
    _exit(0);
  }
  CHECK(IsBeingWritten(path));
  REQUIRE(file->Commit().ok());
  const UniqueFd reader(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  REQUIRE(reader.valid());
  CHECK(flock(reader.get(), LOCK_SH | LOCK_NB) == 0);
  close(pipe_ends[0]);
  close(pipe_ends[1]);
  int status = 0;
  CHECK(waitpid(child, &status, 0) == child);
}

TEST_CASE("A path no longer names a file that was removed, nor one that another has replaced") {
  const TemporaryFolder folder;
  const std::string path = folder.File("lock");
  WriteBytes(path, "");
  const UniqueFd fd(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  CHECK(StillNamed(fd.get(), path));
  REQUIRE(unlink(path.c_str()) == 0);
  CHECK_FALSE(StillNamed(fd.get(), path));
  WriteBytes(path, "");
  CHECK_FALSE(StillNamed(fd.get(), path));
}

TEST_CASE("A file that appears before the commit is kept, if it is to be, or replaced") {
  const TemporaryFolder folder;
  const std::string path = folder.File("rows.csv");
  for (const Existing existing : {Existing::kKeep, Existing::kReplace}) {
    Result<AtomicFile> file = AtomicFile::Create(path);
    REQUIRE(file.ok());
    REQUIRE(file->Write("new").ok());
    WriteBytes(path, "the user's");
    const Status committed = file->Commit(existing);
    const bool keeps = existing == Existing::kKeep;
    CHECK(committed.code() == (keeps ? StatusCode::kFailedPrecondition : StatusCode::kOk));
    CHECK(ReadBytes(path) == (keeps ? "the user's" : "new"));
  }
  Result<AtomicFile> file = AtomicFile::Create(folder.File("other.csv"));
  REQUIRE(file.ok());
  CHECK(file->Commit(Existing::kKeep).ok());
  CHECK(ReadBytes(folder.File("other.csv")).empty());
}

TEST_CASE("A user's file beside a file that is written stays") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("rows.csv.tmp"), "precious");
  REQUIRE(WriteSmallFile(folder.File("rows.csv"), "new").ok());
  CHECK(ReadBytes(folder.File("rows.csv.tmp")) == "precious");
}

}  // namespace b4mrl

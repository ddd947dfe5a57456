#include "data/files/atomic_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <cerrno>
#include <filesystem>
#include <iterator>
#include <string>

#include "proto/base/unique_fd.h"
#include "tests/data/temporary_folder.h"

namespace {

// With which every lock is refused; 0: none is.
int lock_error = 0;

}  // namespace

// Takes the C library's place, as no file system without locks is at hand.
extern "C" int flock(int fd, int operation) noexcept {
  if (lock_error == 0) return static_cast<int>(syscall(SYS_flock, fd, operation));
  errno = lock_error;
  return -1;
}

namespace b4mrl {

TEST_CASE("Without locks, writers of one file have temporary files of their own, and leave none") {
  const TemporaryFolder folder;
  const std::string path = folder.File("manifest.json");
  lock_error = GENERATE(ENOSYS, EOPNOTSUPP);
  {
    Result<AtomicFile> first = AtomicFile::Create(path, mode_t{0600});
    Result<AtomicFile> second = AtomicFile::Create(path);
    const Result<AtomicFile> given_up = AtomicFile::Create(path);
    const bool is_seen = IsBeingWritten(path);
    lock_error = 0;
    REQUIRE(first.ok());
    REQUIRE(second.ok());
    REQUIRE(given_up.ok());
    CHECK_FALSE(is_seen);
    CHECK(first->Write("first").ok());
    CHECK(second->Write("second").ok());
    CHECK(second->Commit().ok());
    CHECK(first->Commit().ok());
  }
  CHECK(ReadBytes(path) == "first");
  struct stat info {};
  REQUIRE(stat(path.c_str(), &info) == 0);
  CHECK((info.st_mode & 0777) == 0600);
  const std::filesystem::directory_iterator left(folder.path());
  CHECK(std::distance(begin(left), end(left)) == 1);
}

TEST_CASE("A lock that is refused for another reason is an error") {
  const TemporaryFolder folder;
  lock_error = EBADF;
  const Status refused = AtomicFile::Create(folder.File("manifest.json")).status();
  lock_error = 0;
  CHECK(refused.code() == StatusCode::kIoError);
}

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

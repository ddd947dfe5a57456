// What a program was built from. Any thread.
#pragma once

#include <string>
#include <string_view>

namespace b4mrl {

// The project's version, as "0.1.0", from `project` in CMakeLists.txt.
std::string_view ProjectVersion();

// For which processors learners were compiled, as -march= names them: "x86-64-v3", or "native
// (rocketlake)" with the compiler's name for the processor of the machine that compiled them.
std::string_view LearnerArchitecture();

// The checkout's commit: "3f2a9c0d1e4b", with "-dirty" if files differed from it; "" if there was
// none. The libraries do not define it: every program links the object b4mrl_commit
// (proto/CMakeLists.txt), so that after a commit one file is compiled and only programs are linked;
// tests/catch_main.cc defines it for tests.
std::string_view BuildCommit();

// What --version prints: "b4mrl 0.1.0, commit 3f2a9c0d1e4b, learners for native (rocketlake)".
inline std::string VersionText() {
  const std::string_view commit = BuildCommit().empty() ? "unknown" : BuildCommit();
  std::string text = "b4mrl ";
  text.append(ProjectVersion()).append(", commit ").append(commit);
  return text.append(", learners for ").append(LearnerArchitecture());
}

}  // namespace b4mrl

#include "server/environments/mujoco/mujoco_guard.h"

#include <spdlog/spdlog.h>

#include <csetjmp>
#include <cstdlib>
#include <cstring>

// Exported by libmujoco 2.2.2 for its own bindings, but declared in no installed header.
extern "C" {
void _mjPRIVATE__set_tls_error_fn(void (*handler)(const char*));
}

namespace b4mrl {
namespace {

thread_local std::jmp_buf jump_target;
thread_local char last_error[256];

void JumpBack(const char* message) {
  std::strncpy(last_error, message, sizeof(last_error) - 1);
  std::longjmp(jump_target, 1);
}

void EndProcess(const char* message) {
  spdlog::critical("MuJoCo error outside a step: {}", message);
  std::abort();  // its signal makes a worker record which thread failed
}

// Drops MuJoCo's warning texts: mjData counts warnings, and MuJoCo's own handler writes a file.
void DropWarning(const char*) {}

}  // namespace

void InstallMujocoHandlers() {
  static const bool installed = [] {
    mju_user_error = EndProcess;
    mju_user_warning = DropWarning;
    return true;
  }();
  static_cast<void>(installed);
}

bool RunGuarded(void (*function)(void*), void* argument) {
  if (setjmp(jump_target) != 0) {
    _mjPRIVATE__set_tls_error_fn(nullptr);
    return false;
  }
  _mjPRIVATE__set_tls_error_fn(JumpBack);
  function(argument);
  _mjPRIVATE__set_tls_error_fn(nullptr);
  return true;
}

const char* LastMujocoError() { return last_error; }

}  // namespace b4mrl

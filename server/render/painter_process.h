// A worker's b4mrl-render process: started for the first picture, replaced when it has died.
//
// A picture that the process cannot draw, or not within limits::kPaintMs, fails its own Render
// request and nothing else of the worker. Thread rule: one thread, which waits for every picture
// and therefore must not step lanes. That thread must outlive the object, since the process dies
// with the thread that started it.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <span>
#include <string>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"
#include "server/render/paint_messages.h"

namespace b4mrl {

class PainterProcess {
 public:
  // `program`: the executable; "" is b4mrl-render beside the running program.
  explicit PainterProcess(std::string program = "") : program_(std::move(program)) {}
  ~PainterProcess();
  PainterProcess(const PainterProcess&) = delete;
  PainterProcess& operator=(const PainterProcess&) = delete;

  // Draws into `picture`, which has PictureBytes(width, height). kUnsupported without the program
  // or where Mesa cannot draw; kInternal when drawing ended the process or did not end; else the
  // painter's answer.
  Status Paint(const PaintRequest& request, std::span<std::byte> picture);

  // Of the painter; 0 if none runs.
  pid_t process_id() const { return process_id_; }

 private:
  Status Start();
  // True if the process runs; reaps one that has ended.
  bool Alive();
  Status Exchange(const PaintRequest& request, std::span<std::byte> picture, bool* conversing);
  // Kills the process if it still runs; returns its wait status, as waitpid does.
  int End();

  std::string program_;
  pid_t process_id_ = 0;
  UniqueFd socket_;
};

}  // namespace b4mrl

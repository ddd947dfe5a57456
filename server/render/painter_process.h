// A worker's b4mrl-render process: started for the first picture, replaced when it has died.
//
// A picture that the process cannot draw, or not within limits::kPaintMs, fails its own Render
// request and nothing else of the worker. A simulator whose pictures cost too much processor time
// is not drawn for a while, because the pictures of all others wait for each of its own.
// Thread rule: one thread, which waits for every picture and therefore must not step lanes. It must
// outlive the object, since the process dies with the thread that started it.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
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
  // or where Mesa cannot draw; kInternal when drawing ended the process or did not end;
  // kDeadlineExceeded soon after `deadline`; kLimitExceeded for a simulator that is not drawn for a
  // while; else the painter's answer.
  Status Paint(const PaintRequest& request, std::span<std::byte> picture, const Deadline& deadline);

  // Of the painter; 0 if none runs.
  pid_t process_id() const { return process_id_; }

 private:
  // A picture that the painter goes on with though nobody waits for it any more.
  struct LatePicture {
    uint64_t identity;  // of its simulator
    size_t bytes;
    Deadline end;  // the painter is killed then if another picture is wanted
  };
  // The pictures of a simulator that took too much processor time.
  struct SlowPictures {
    uint32_t count = 0;
    Clock::time_point forgotten{};
  };

  Status Start();
  // True if the process runs; reaps one that has ended.
  bool Alive();
  // *conversing: the painter answered, or will.
  Status Exchange(const PaintRequest& request, std::span<std::byte> picture,
                  const Deadline& deadline, bool* conversing);
  // Waits until the painter is done with the late picture, if there is one, or kills the painter.
  // kDeadlineExceeded if the picture goes on.
  Status FinishLatePicture(const Deadline& deadline);
  // Kills the process if it still runs; returns its wait status, as waitpid does.
  int End();
  // Ends the process as End does, and remembers the simulator `identity`, whose picture was being
  // drawn, if the process ended because of the picture's processor time.
  int EndWhileDrawing(uint64_t identity);
  Status CheckNotTooSlow(uint64_t identity) const;

  std::string program_;
  pid_t process_id_ = 0;
  UniqueFd socket_;
  std::optional<LatePicture> late_;
  std::map<uint64_t, SlowPictures> slow_;  // by the simulator's identity
};

}  // namespace b4mrl

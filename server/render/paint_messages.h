// The messages between an environment worker and its b4mrl-render process, which have one end each
// of a stream socket. The two programs are built together and run on one machine, so that numbers
// travel as they lie in memory. One request, one answer, in turn.
//
// Thread rule: one thread an end. Errors of the conversation itself are kUnavailable (the other end
// is gone), kDeadlineExceeded and kDataLoss (bytes that this build would not have written).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "server/simulator/simulator.h"

namespace b4mrl {

// Asks for one picture of one lane.
struct PaintRequest {
  SimulatorRequest simulator;
  // Simulator::identity_hash(): the model file may have changed since the session was opened.
  uint64_t identity = 0;
  uint32_t width = 0;  // pixels; limits::kMinPictureSide to limits::kMaxPictureSide
  uint32_t height = 0;
  uint64_t lane_seed = 0;  // with the episode, for Simulator::EnterEpisode
  uint64_t episode = 0;
  std::vector<double> state;  // for Environment::LoadState
};

// Bytes of a picture: rows from the top, pixels from the left, red, green, blue.
inline size_t PictureBytes(uint32_t width, uint32_t height) { return size_t{3} * width * height; }

// The worker's end. `picture` has PictureBytes(width, height) bytes. A painter's refusal is
// returned as the painter sent it; the next request may follow, as after OK.
Status SendPaintRequest(int fd, const PaintRequest& request, const Deadline& deadline);
// *refused is true for an error that the painter sent, false for one of the connection.
Status ReceivePicture(int fd, std::span<std::byte> picture, const Deadline& deadline,
                      bool* refused);

// The painter's end. Waits for a request's first byte until `idle`, and then limits::kPaintMs for
// all of its bytes.
Result<PaintRequest> ReceivePaintRequest(int fd, const Deadline& idle);
// Sends `picture` if `status` is OK, else the status alone.
Status SendPicture(int fd, const Status& status, std::span<const std::byte> picture);

}  // namespace b4mrl

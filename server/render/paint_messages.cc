#include "server/render/paint_messages.h"

#include <poll.h>
#include <sys/socket.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <type_traits>

#include "proto/base/child_program.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr uint32_t kRequestMagic = 0xb4301dea;
constexpr uint32_t kAnswerMagic = 0xb4301deb;
constexpr uint32_t kMaxTextBytes = 64 * 1024;
constexpr size_t kTexts = 5;

struct RequestHeader {
  uint32_t magic;
  uint32_t width;
  uint32_t height;
  uint32_t state_doubles;
  uint64_t identity;
  uint64_t lane_seed;
  uint64_t episode;
  std::array<uint64_t, kTexts> text_bytes;  // of SimulatorTexts, which follow the header
};

struct AnswerHeader {
  uint32_t magic;
  int32_t code;
  uint32_t message_bytes;
  uint32_t picture_bytes;
};

Status Gone() { return Status(StatusCode::kUnavailable, "the other end is gone"); }

Status ReceiveAll(int fd, void* bytes, size_t size, const Deadline& deadline) {
  auto* next = static_cast<std::byte*>(bytes);
  while (size > 0) {
    const ssize_t got = recv(fd, next, size, MSG_DONTWAIT);
    if (got > 0) {
      next += got;
      size -= static_cast<size_t>(got);
    } else if (got < 0 && errno == EAGAIN) {
      B4MRL_RETURN_IF_ERROR(WaitUntilReady(fd, POLLIN, deadline));
    } else if (got == 0 || errno != EINTR) {
      return Gone();
    }
  }
  return Status();
}

template <typename Container>
Status ReceiveInto(int fd, size_t elements, const Deadline& deadline, Container* out) {
  out->resize(elements);
  return ReceiveAll(fd, out->data(), elements * sizeof(*out->data()), deadline);
}

bool SideFits(uint32_t side) {
  return side >= limits::kMinPictureSide && side <= limits::kMaxPictureSide;
}

using SimulatorTexts = std::array<std::string, kTexts>;

SimulatorTexts ToTexts(const SimulatorRequest& request) {
  return {request.environment, FormatNamedArguments(request.perturbations), request.config,
          request.compiled_model.path, request.compiled_model.hash};
}

Result<SimulatorRequest> FromTexts(SimulatorTexts texts) {
  SimulatorRequest request;
  B4MRL_ASSIGN_OR_RETURN(request.perturbations, ParseNamedArguments(texts[1]));
  request.environment = std::move(texts[0]);
  request.config = std::move(texts[2]);
  request.compiled_model = {std::move(texts[3]), std::move(texts[4])};
  return request;
}

Status CheckHeader(const RequestHeader& header) {
  const bool texts_fit =
      std::ranges::all_of(header.text_bytes, [](uint64_t bytes) { return bytes <= kMaxTextBytes; });
  if (header.magic == kRequestMagic && texts_fit && SideFits(header.width) &&
      SideFits(header.height) &&
      header.state_doubles <= limits::kLaneBufferBytes / sizeof(double)) {
    return Status();
  }
  return Status(StatusCode::kDataLoss, "not a request of this build's worker");
}

}  // namespace

Status SendPaintRequest(int fd, const PaintRequest& request, const Deadline& deadline) {
  const SimulatorTexts texts = ToTexts(request.simulator);
  RequestHeader header = {.magic = kRequestMagic,
                          .width = request.width,
                          .height = request.height,
                          .state_doubles = static_cast<uint32_t>(request.state.size()),
                          .identity = request.identity,
                          .lane_seed = request.lane_seed,
                          .episode = request.episode,
                          .text_bytes = {}};
  static_assert(std::has_unique_object_representations_v<RequestHeader>);
  for (size_t i = 0; i < kTexts; ++i) {
    header.text_bytes[i] = texts[i].size();
  }
  B4MRL_RETURN_IF_ERROR(SendAll(fd, std::as_bytes(std::span(&header, 1)), deadline));
  for (const std::string& text : texts) {
    B4MRL_RETURN_IF_ERROR(SendAll(fd, std::as_bytes(std::span(text)), deadline));
  }
  return SendAll(fd, std::as_bytes(std::span(request.state)), deadline);
}

Status ReceivePicture(int fd, std::span<std::byte> picture, const Deadline& deadline,
                      bool* refused) {
  *refused = false;
  AnswerHeader header{};
  B4MRL_RETURN_IF_ERROR(ReceiveAll(fd, &header, sizeof(header), deadline));
  const bool ok = header.code == 0;
  if (header.magic != kAnswerMagic || header.message_bytes > kMaxTextBytes ||
      header.picture_bytes != (ok ? picture.size() : 0)) {
    return Status(StatusCode::kDataLoss, "not an answer of this build's b4mrl-render");
  }
  if (ok) return ReceiveAll(fd, picture.data(), picture.size(), deadline);
  std::string message;
  B4MRL_RETURN_IF_ERROR(ReceiveInto(fd, header.message_bytes, deadline, &message));
  *refused = true;
  return Status(static_cast<StatusCode>(header.code), std::move(message));
}

Result<PaintRequest> ReceivePaintRequest(int fd, const Deadline& idle) {
  B4MRL_RETURN_IF_ERROR(WaitUntilReady(fd, POLLIN, idle));
  const Deadline deadline = Deadline::AfterMs(limits::kPaintMs);
  RequestHeader header{};
  B4MRL_RETURN_IF_ERROR(ReceiveAll(fd, &header, sizeof(header), deadline));
  B4MRL_RETURN_IF_ERROR(CheckHeader(header));
  SimulatorTexts texts;
  for (size_t i = 0; i < kTexts; ++i) {
    B4MRL_RETURN_IF_ERROR(ReceiveInto(fd, header.text_bytes[i], deadline, &texts[i]));
  }
  PaintRequest request;
  B4MRL_ASSIGN_OR_RETURN(request.simulator, FromTexts(std::move(texts)));
  request.width = header.width;
  request.height = header.height;
  request.identity = header.identity;
  request.lane_seed = header.lane_seed;
  request.episode = header.episode;
  B4MRL_RETURN_IF_ERROR(ReceiveInto(fd, header.state_doubles, deadline, &request.state));
  return request;
}

Status SendPicture(int fd, const Status& status, std::span<const std::byte> picture) {
  const Deadline deadline = Deadline::AfterMs(limits::kPaintMs);
  const std::string message = status.message().substr(0, kMaxTextBytes);
  if (!status.ok()) picture = {};
  const AnswerHeader header = {kAnswerMagic, static_cast<int32_t>(status.code()),
                               static_cast<uint32_t>(message.size()),
                               static_cast<uint32_t>(picture.size())};
  B4MRL_RETURN_IF_ERROR(SendAll(fd, std::as_bytes(std::span(&header, 1)), deadline));
  B4MRL_RETURN_IF_ERROR(SendAll(fd, std::as_bytes(std::span(message)), deadline));
  return SendAll(fd, picture, deadline);
}

}  // namespace b4mrl

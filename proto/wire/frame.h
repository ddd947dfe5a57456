// Frames of a message and the arrays inside them.
//
// A message is an envelope (frame 1: a serialised pb::Request or pb::Reply) and, if it has arrays,
// a payload (frame 2: the arrays' raw bytes). ArrayLayout plans a payload, so that results are
// written straight into the frame that is sent; ArrayReader validates a received payload before its
// arrays are used. Frames are owned by one thread at a time and are moved, never copied.
#pragma once

#include <array>
#include <cstddef>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"
#include "proto/wire/tensor.h"

namespace b4mrl {

// One ZeroMQ message part; moving it moves the bytes' ownership.
class Frame {
 public:
  Frame();  // empty
  ~Frame();
  Frame(Frame&& other) noexcept;
  Frame& operator=(Frame&& other) noexcept;
  Frame(const Frame&) = delete;
  Frame& operator=(const Frame&) = delete;

  // A frame of uninitialised bytes. Callers keep to limits::kMaxPayloadBytes.
  static Frame OfSize(size_t size);
  static Frame Copy(std::string_view bytes);
  // A second frame that shares this frame's bytes, which must not be changed from now on.
  Frame Share();

  std::byte* data();
  const std::byte* data() const;
  size_t size() const;
  std::string_view view() const { return {reinterpret_cast<const char*>(data()), size()}; }
  // The zmq_msg_t inside, for socket.cc and unread_bytes.cc.
  void* handle() { return storage_.data(); }

 private:
  alignas(8) std::array<std::byte, 64> storage_;
};

// Envelope and payload of one message.
struct Message {
  Frame envelope;
  Frame payload;  // size 0: the message has no payload
};

// Collects array descriptions in an envelope's table and lays the arrays out at aligned offsets;
// then the payload is allocated once and the arrays are written in place.
class ArrayLayout {
 public:
  // `table` outlives this object. Arrays that are already in it take the payload's first `used`
  // bytes.
  explicit ArrayLayout(google::protobuf::RepeatedPtrField<pb::Array>* table, size_t used = 0)
      : table_(table), size_(used) {}
  // Adds an array and returns its offset in the payload, for ArrayAt.
  size_t Add(std::string_view name, DType dtype, std::initializer_list<uint64_t> shape);

  size_t payload_bytes() const { return size_; }
  // Allocates the payload. Gaps between arrays are zero, the arrays' bytes are not initialised.
  Frame Allocate() const;

 private:
  google::protobuf::RepeatedPtrField<pb::Array>* table_;
  size_t size_;
};

// The `count` elements of type T at `offset` of a payload made by ArrayLayout::Allocate.
template <typename T>
std::span<T> ArrayAt(Frame& payload, size_t offset, size_t count) {
  return {reinterpret_cast<T*>(payload.data() + offset), count};
}

// Validated access to the arrays of a received message. Holds views into `payload`, which must
// outlive the reader (and may be moved), unless the bytes had to be copied to be aligned.
class ArrayReader {
 public:
  // Refuses tables with too many arrays or dimensions, duplicate names, unknown types, misaligned
  // offsets, sizes that overflow, and arrays that reach beyond the payload.
  static Result<ArrayReader> Parse(const google::protobuf::RepeatedPtrField<pb::Array>& table,
                                   std::span<const std::byte> payload);
  static Result<ArrayReader> Parse(const google::protobuf::RepeatedPtrField<pb::Array>& table,
                                   const Frame& payload) {
    return Parse(table, std::span<const std::byte>(payload.data(), payload.size()));
  }

  bool Has(std::string_view name) const { return Find(name) != nullptr; }
  const TensorView* Find(std::string_view name) const;
  // The array `name` with one of the types in `dtypes` and exactly this shape (kAny matches every
  // extent); otherwise an error that names the array, its type or shape, and what is allowed.
  static constexpr uint64_t kAny = UINT64_MAX;
  Result<TensorView> Require(std::string_view name, std::initializer_list<DType> dtypes,
                             std::initializer_list<uint64_t> shape) const;

 private:
  struct Named {
    std::string name;
    TensorView view;
  };
  std::vector<Named> arrays_;
  std::vector<uint64_t> aligned_copy_;  // 8-byte aligned storage when the frame itself is not
};

// Serialises `envelope` into a frame; kInvalidArgument above limits::kMaxEnvelopeBytes.
Result<Frame> SerializeEnvelope(const google::protobuf::MessageLite& envelope);
// Parses frame 1 into `envelope`; refuses frames above limits::kMaxEnvelopeBytes and bytes that are
// no message of the envelope's type.
Status ParseEnvelope(const Frame& frame, google::protobuf::MessageLite* envelope);

// Convert a Status to and from its message; an unknown code from a newer peer becomes kInternal.
void SetStatus(const Status& status, pb::Status* out);
Status GetStatus(const pb::Status& status);

}  // namespace b4mrl

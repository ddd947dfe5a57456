#include "proto/wire/frame.h"

#include <fmt/format.h>
#include <zmq.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "proto/base/limits.h"
#include "proto/base/spec.h"

namespace b4mrl {
namespace {

// Whether an enumerator of ours has the number that b4mrl.proto gives it.
template <typename Ours, typename Wire>
constexpr bool AreEqual(Ours ours, Wire wire) {
  return static_cast<int>(ours) == static_cast<int>(wire);
}
static_assert(AreEqual(DType::kUnspecified, pb::DTYPE_UNSPECIFIED) &&
              AreEqual(DType::kFloat32, pb::FLOAT32) && AreEqual(DType::kFloat64, pb::FLOAT64) &&
              AreEqual(DType::kInt32, pb::INT32) && AreEqual(DType::kInt64, pb::INT64) &&
              AreEqual(DType::kUint8, pb::UINT8) && AreEqual(DType::kUint32, pb::UINT32) &&
              AreEqual(DType::kUint64, pb::UINT64));
static_assert(AreEqual(Cause::kNone, pb::CAUSE_NONE) &&
              AreEqual(Cause::kUnhealthy, pb::UNHEALTHY) && AreEqual(Cause::kLimit, pb::LIMIT) &&
              AreEqual(Cause::kCrash, pb::CRASH) &&
              AreEqual(Cause::kNumericalError, pb::NUMERICAL_ERROR));
static_assert(AreEqual(AutoresetMode::kNextStep, pb::NEXT_STEP) &&
              AreEqual(AutoresetMode::kSameStep, pb::SAME_STEP) &&
              AreEqual(AutoresetMode::kDisabled, pb::DISABLED));

static_assert(sizeof(zmq_msg_t) == 64, "Frame::storage_ holds a zmq_msg_t");

zmq_msg_t* AsZmq(void* storage) { return static_cast<zmq_msg_t*>(storage); }

std::string FormatShape(const Shape& shape) {
  std::string text = "(";
  for (size_t i = 0; i < shape.size(); ++i) {
    text += i == 0 ? "" : ", ";
    text += shape[i] == ArrayReader::kAny ? "any" : std::to_string(shape[i]);
  }
  return text + ")";
}

// The bytes of a table entry, or nothing if any product overflows.
std::optional<uint64_t> ArrayBytes(const pb::Array& entry) {
  uint64_t bytes = DTypeSize(static_cast<DType>(entry.dtype()));
  for (const uint64_t extent : entry.shape()) {
    if (__builtin_mul_overflow(bytes, extent, &bytes)) return std::nullopt;
  }
  return bytes;
}

Status CheckEntry(const pb::Array& entry, size_t payload_size) {
  const auto context = [&entry](const char* what) {
    return fmt::format("array '{}' {}", entry.name().substr(0, 64), what);
  };
  // Proto3 enumerations hold any number; the cast alone would fold 257 and -255 onto float32.
  if (entry.dtype() < pb::FLOAT32 || entry.dtype() > pb::UINT64) {
    return InvalidNumber(context("dtype"), entry.dtype(), "1..7");
  }
  if (static_cast<size_t>(entry.shape_size()) > limits::kMaxArrayDimensions) {
    return InvalidNumber(context("dimensions"), entry.shape_size(),
                         fmt::format("at most {}", limits::kMaxArrayDimensions));
  }
  if (entry.offset() % limits::kArrayAlignment != 0) {
    return InvalidNumber(context("offset"), static_cast<double>(entry.offset()),
                         fmt::format("multiples of {}", limits::kArrayAlignment));
  }
  const std::optional<uint64_t> bytes = ArrayBytes(entry);
  if (!bytes || entry.offset() > payload_size || *bytes > payload_size - entry.offset()) {
    const bool ends = bytes && *bytes <= UINT64_MAX - entry.offset();
    return InvalidArgument(context("end"),
                           ends ? std::to_string(entry.offset() + *bytes) : "beyond 2^64",
                           fmt::format("within the payload's {} bytes", payload_size));
  }
  return Status();
}

Status EnvelopeTooLarge(size_t bytes) {
  return InvalidNumber("bytes of the envelope", static_cast<double>(bytes),
                       fmt::format("at most {}", limits::kMaxEnvelopeBytes));
}

}  // namespace

Frame::Frame() { zmq_msg_init(AsZmq(storage_.data())); }
Frame::~Frame() { zmq_msg_close(AsZmq(storage_.data())); }

Frame::Frame(Frame&& other) noexcept : Frame() { *this = std::move(other); }

Frame& Frame::operator=(Frame&& other) noexcept {
  if (this != &other) zmq_msg_move(AsZmq(storage_.data()), AsZmq(other.storage_.data()));
  return *this;
}

Frame Frame::OfSize(size_t size) {
  Frame frame;
  // This call only fails when memory is exhausted, and then no request could be answered.
  if (zmq_msg_init_size(AsZmq(frame.storage_.data()), size) != 0) std::abort();
  return frame;
}

Frame Frame::Copy(std::string_view bytes) {
  Frame frame = OfSize(bytes.size());
  if (!bytes.empty()) std::memcpy(frame.data(), bytes.data(), bytes.size());
  return frame;
}

Frame Frame::Share() {
  Frame frame;
  zmq_msg_copy(AsZmq(frame.storage_.data()), AsZmq(storage_.data()));
  return frame;
}

std::byte* Frame::data() { return static_cast<std::byte*>(zmq_msg_data(AsZmq(storage_.data()))); }
const std::byte* Frame::data() const { return const_cast<Frame*>(this)->data(); }
size_t Frame::size() const { return zmq_msg_size(AsZmq(const_cast<std::byte*>(storage_.data()))); }

size_t ArrayLayout::Add(std::string_view name, DType dtype, std::initializer_list<uint64_t> shape) {
  constexpr size_t kMask = limits::kArrayAlignment - 1;
  const size_t offset = (size_ + kMask) & ~kMask;
  pb::Array* entry = table_->Add();
  entry->set_name(std::string(name));
  entry->set_dtype(static_cast<pb::DType>(dtype));
  entry->set_offset(offset);
  uint64_t bytes = DTypeSize(dtype);
  for (const uint64_t extent : shape) {
    entry->add_shape(extent);
    bytes *= extent;
  }
  size_ = offset + bytes;
  return offset;
}

Frame ArrayLayout::Allocate() const {
  Frame payload = Frame::OfSize(size_);
  for (int i = 0; i + 1 < table_->size(); ++i) {
    const pb::Array& entry = table_->Get(i);
    const size_t end = entry.offset() + ArrayBytes(entry).value_or(0);
    const size_t next = table_->Get(i + 1).offset();
    if (end < next && next <= size_) std::memset(payload.data() + end, 0, next - end);
  }
  return payload;
}

Result<ArrayReader> ArrayReader::Parse(const google::protobuf::RepeatedPtrField<pb::Array>& table,
                                       std::span<const std::byte> payload) {
  if (static_cast<size_t>(table.size()) > limits::kMaxArraysPerMessage) {
    return InvalidNumber("number of arrays", table.size(),
                         fmt::format("at most {}", limits::kMaxArraysPerMessage));
  }
  ArrayReader reader;
  const std::byte* base = payload.data();
  // Small messages lie inside the frame object itself, which may move while its views live on.
  const bool may_move = payload.size() <= sizeof(zmq_msg_t);
  const bool unaligned = reinterpret_cast<uintptr_t>(base) % sizeof(uint64_t) != 0;
  if (table.size() > 0 && !payload.empty() && (may_move || unaligned)) {
    reader.aligned_copy_.resize((payload.size() + 7) / 8);
    std::memcpy(reader.aligned_copy_.data(), base, payload.size());
    base = reinterpret_cast<const std::byte*>(reader.aligned_copy_.data());
  }
  reader.arrays_.reserve(table.size());
  for (const pb::Array& entry : table) {
    B4MRL_RETURN_IF_ERROR(CheckEntry(entry, payload.size()));
    if (reader.Has(entry.name())) {
      return InvalidArgument("array name", entry.name(), "each name once");
    }
    TensorView view{static_cast<DType>(entry.dtype()),
                    {entry.shape().begin(), entry.shape().end()},
                    base + entry.offset()};
    reader.arrays_.push_back({entry.name(), std::move(view)});
  }
  return reader;
}

const TensorView* ArrayReader::Find(std::string_view name) const {
  for (const Named& array : arrays_) {
    if (array.name == name) return &array.view;
  }
  return nullptr;
}

Result<TensorView> ArrayReader::Require(std::string_view name, std::initializer_list<DType> dtypes,
                                        std::initializer_list<uint64_t> shape) const {
  const TensorView* view = Find(name);
  if (view == nullptr) {
    return Status(StatusCode::kInvalidArgument, fmt::format("array '{}' is missing", name));
  }
  if (std::find(dtypes.begin(), dtypes.end(), view->dtype) == dtypes.end()) {
    std::string allowed;
    for (const DType dtype : dtypes) allowed += (allowed.empty() ? "" : " or ") + DTypeName(dtype);
    return InvalidArgument(fmt::format("{} dtype", name), DTypeName(view->dtype), allowed);
  }
  const bool matches =
      std::equal(view->shape.begin(), view->shape.end(), shape.begin(), shape.end(),
                 [](uint64_t got, uint64_t want) { return want == kAny || got == want; });
  if (!matches) {
    return InvalidArgument(fmt::format("{} shape", name), FormatShape(view->shape),
                           FormatShape(shape));
  }
  return *view;
}

Result<Frame> SerializeEnvelope(const google::protobuf::MessageLite& envelope) {
  const size_t size = envelope.ByteSizeLong();
  if (size > limits::kMaxEnvelopeBytes) {
    return EnvelopeTooLarge(size);
  }
  Frame frame = Frame::OfSize(size);
  envelope.SerializeWithCachedSizesToArray(reinterpret_cast<uint8_t*>(frame.data()));
  return frame;
}

Status ParseEnvelope(const Frame& frame, google::protobuf::MessageLite* envelope) {
  if (frame.size() > limits::kMaxEnvelopeBytes) {
    return EnvelopeTooLarge(frame.size());
  }
  // To Protocol Buffers, zero bytes are a message with default values; here they mean a malformed
  // message.
  if (frame.size() == 0) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("the envelope is empty or the message has too many frames, allowed: "
                              "1 to {} frames from a DEALER socket (a REQ socket puts an empty one "
                              "before them)",
                              limits::kMaxFramesPerMessage));
  }
  if (!envelope->ParseFromArray(frame.data(), static_cast<int>(frame.size()))) {
    return Status(StatusCode::kInvalidArgument, "the envelope is not a valid message");
  }
  return Status();
}

void SetStatus(const Status& status, pb::Status* out) {
  out->set_code(static_cast<int32_t>(status.code()));
  // Messages quote bytes of peers; bytes that are not printable ASCII would break clients that
  // demand UTF-8.
  std::string message = status.message();
  for (char& c : message) {
    if (c < 0x20 || c > 0x7e) c = '?';
  }
  out->set_message(std::move(message));
  out->set_recoverable(status.recoverable());
}

Status GetStatus(const pb::Status& status) {
  if (status.code() == 0) return Status();
  const StatusCode code = static_cast<StatusCode>(status.code());
  if (StatusCodeName(code) == "UNKNOWN") {
    return Status(StatusCode::kInternal,
                  fmt::format("code {} of a newer server: {}", status.code(), status.message()));
  }
  return Status(code, status.message());
}

}  // namespace b4mrl

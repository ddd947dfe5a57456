#include "tests/conformance/case_message.h"

#include <fmt/format.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

#include "proto/base/limits.h"
#include "proto/wire/tensor.h"

namespace b4mrl::conformance {
namespace {

using Json = nlohmann::json;

Status Mistake(std::string text) { return {StatusCode::kInvalidArgument, std::move(text)}; }
Status Mismatch(std::string text) { return {StatusCode::kInternal, std::move(text)}; }

// 64-bit numbers may be strings, as JSON's own are doubles in many languages.
uint64_t AsUnsigned(const Json& value) {
  return value.is_string() ? std::stoull(value.get<std::string>()) : value.get<uint64_t>();
}

double AsDouble(const Json& value) {
  if (!value.is_string()) return value.get<double>();
  if (value == "nan") return std::numeric_limits<double>::quiet_NaN();
  return std::numeric_limits<double>::infinity();
}

int DTypeNumber(const Json& dtype) {
  pb::DType number = pb::DTYPE_UNSPECIFIED;
  if (dtype.is_number()) return dtype.get<int>();
  return pb::DType_Parse(dtype.get<std::string>(), &number) ? number : -1;
}

template <typename T, typename Convert>
void Append(const Json& value, Convert convert, std::string* out) {
  const T number = static_cast<T>(convert(value));
  out->append(reinterpret_cast<const char*>(&number), sizeof(number));
}

void AppendNumber(const Json& value, int dtype, std::string* out) {
  const auto as_signed = [](const Json& json) { return json.get<int64_t>(); };
  switch (static_cast<DType>(dtype)) {
    case DType::kFloat32:
      return Append<float>(value, AsDouble, out);
    case DType::kFloat64:
      return Append<double>(value, AsDouble, out);
    case DType::kInt32:
      return Append<int32_t>(value, as_signed, out);
    case DType::kInt64:
      return Append<int64_t>(value, as_signed, out);
    case DType::kUint32:
      return Append<uint32_t>(value, AsUnsigned, out);
    case DType::kUint64:
      return Append<uint64_t>(value, AsUnsigned, out);
    default:
      return Append<uint8_t>(value, AsUnsigned, out);
  }
}

std::string BytesOf(const Json& values, int dtype, const std::vector<uint64_t>& shape) {
  std::string bytes;
  if (values.is_array()) {
    for (const Json& value : values) AppendNumber(value, dtype, &bytes);
    return bytes;
  }
  uint64_t count = 1;
  for (const uint64_t extent : shape) count *= extent;
  for (uint64_t i = 0; i < count; ++i) AppendNumber(values, dtype, &bytes);
  return bytes;
}

Result<ArrayBytes> ReadEntry(const Json& entry, const Labels& labels) {
  ArrayBytes array;
  if (entry.at(2).is_string()) {
    const auto reply = labels.find(entry.at(2).get<std::string>());
    if (reply == labels.end()) return Mistake("no such label: " + entry.dump());
    const auto found = reply->second.arrays.find(entry.at(0).get<std::string>());
    if (found == reply->second.arrays.end()) return Mistake("no such array: " + entry.dump());
    return found->second;
  }
  array.dtype = DTypeNumber(entry.at(1));
  for (const Json& extent : entry.at(2)) array.shape.push_back(AsUnsigned(extent));
  if (entry.size() > 3) array.bytes = BytesOf(entry.at(3), array.dtype, array.shape);
  return array;
}

// Whether `part` is in `whole`: members of objects, elements of lists, equal values.
bool Contains(const Json& whole, const Json& part) {
  if (part.is_object()) {
    return std::all_of(part.items().begin(), part.items().end(), [&whole](const auto& item) {
      return whole.is_object() && whole.contains(item.key()) &&
             Contains(whole.at(item.key()), item.value());
    });
  }
  if (part.is_array()) {
    return whole.is_array() && whole.size() == part.size() &&
           std::equal(whole.begin(), whole.end(), part.begin(), Contains);
  }
  return whole == part;
}

Result<Json> ToJson(const pb::Reply& reply) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  options.always_print_primitive_fields = true;
  std::string text;
  if (!google::protobuf::util::MessageToJsonString(reply, &text, options).ok()) {
    return Mismatch("the reply has no JSON form");
  }
  return Json::parse(text);
}

bool IsRecoverable(int code) {
  constexpr int kRecoverable[] = {4, 7, 8, 9};  // BUSY to UNAVAILABLE of PROTOCOL.md, section 6
  return std::count(std::begin(kRecoverable), std::end(kRecoverable), code) > 0;
}

Status CheckError(const pb::Reply& reply, size_t arrays) {
  const pb::Status& status = reply.status();
  const bool printable = std::all_of(status.message().begin(), status.message().end(),
                                     [](char c) { return c >= 0x20 && c <= 0x7e; });
  if (status.message().empty() || !printable) return Mismatch("an error without a readable text");
  if (arrays > 0 || reply.payload_case() != pb::Reply::PAYLOAD_NOT_SET) {
    return Mismatch("an error that carries arrays or a payload");
  }
  if (status.recoverable() != IsRecoverable(status.code())) {
    return Mismatch(
        fmt::format("recoverable is {} for code {}", status.recoverable(), status.code()));
  }
  return Status();
}

// The payload of a success is the one that was asked for.
Status CheckKind(const Json& step, const pb::Reply& reply) {
  if (!step.contains("request")) return Status();
  for (const auto& [name, value] : step.at("request").items()) {
    if (!value.is_object()) continue;
    const auto* field = pb::Reply::descriptor()->FindFieldByName(name);
    if (field != nullptr && reply.GetReflection()->HasField(reply, field)) return Status();
    return Mismatch("the reply's payload is not " + name);
  }
  return Status();
}

Status CheckArrays(const Json& expected, const ReplyMessage& reply) {
  for (const Json& entry : expected) {
    const std::string name = entry.at(0).get<std::string>();
    const auto found = reply.arrays.find(name);
    if (found == reply.arrays.end()) return Mismatch("no array " + name);
    B4MRL_ASSIGN_OR_RETURN(const ArrayBytes wanted, ReadEntry(entry, {}));
    const bool same_values = entry.size() < 4 || found->second.bytes == wanted.bytes;
    if (found->second.dtype == wanted.dtype && found->second.shape == wanted.shape && same_values) {
      continue;
    }
    return Mismatch(fmt::format("array {} has dtype {}, shape ({}){}; expected {}", name,
                                found->second.dtype, fmt::join(found->second.shape, ", "),
                                same_values ? "" : " and other values", entry.dump()));
  }
  return Status();
}

Status CheckExpectations(const Json& expected, const ReplyMessage& reply, const Labels& labels) {
  const pb::Status& status = reply.envelope.status();
  for (const Json& word : expected.value("text", Json::array())) {
    if (status.message().find(word.get<std::string>()) != std::string::npos) continue;
    return Mismatch(fmt::format("'{}' is not in: {}", word.get<std::string>(), status.message()));
  }
  if (status.code() != 0) return Status();
  B4MRL_RETURN_IF_ERROR(CheckArrays(expected.value("arrays", Json::array()), reply));
  for (const Json& name : expected.value("no_arrays", Json::array())) {
    if (reply.arrays.contains(name.get<std::string>())) {
      return Mismatch("unexpected array " + name.get<std::string>());
    }
  }
  if (expected.contains("same_as")) {
    pb::Reply other = labels.at(expected.at("same_as").get<std::string>()).envelope;
    pb::Reply own = reply.envelope;
    for (pb::Reply* copy : {&other, &own}) {
      copy->clear_timing();
      copy->clear_request_id();
      copy->clear_arrays();
    }
    if (own.SerializeAsString() != other.SerializeAsString() ||
        reply.arrays != labels.at(expected.at("same_as").get<std::string>()).arrays) {
      return Mismatch("differs from the reply that it should repeat");
    }
  }
  if (!expected.contains("reply")) return Status();
  B4MRL_ASSIGN_OR_RETURN(const Json json, ToJson(reply.envelope));
  if (Contains(json, expected.at("reply"))) return Status();
  return Mismatch("the reply is " + json.dump());
}

}  // namespace

std::string FromHex(const std::string& text) {
  std::string bytes;
  for (size_t i = 0; i + 1 < text.size(); i += 2) {
    bytes += static_cast<char>(std::stoi(text.substr(i, 2), nullptr, 16));
  }
  return bytes;
}

Result<Message> BuildRequest(const Json& step, const std::string& token, uint64_t id,
                             const Labels& labels) {
  pb::Request request;
  const std::string text = step.at("request").dump();
  const auto parsed = google::protobuf::util::JsonStringToMessage(text, &request);
  if (!parsed.ok()) return Mistake(fmt::format("{}: {}", parsed.ToString(), text));
  if (!step.at("request").contains("protocol_version")) {
    request.set_protocol_version(limits::kProtocolVersion);
  }
  request.set_session_token(token);
  request.set_request_id(id);
  std::string payload;
  for (const Json& entry : step.value("arrays", Json::array())) {
    B4MRL_ASSIGN_OR_RETURN(const ArrayBytes array, ReadEntry(entry, labels));
    payload.resize((payload.size() + limits::kArrayAlignment - 1) / limits::kArrayAlignment *
                   limits::kArrayAlignment);
    pb::Array* out = request.add_arrays();
    out->set_name(entry.at(0).get<std::string>());
    out->set_dtype(static_cast<pb::DType>(array.dtype));
    out->mutable_shape()->Assign(array.shape.begin(), array.shape.end());
    out->set_offset(entry.size() > 4 ? AsUnsigned(entry.at(4)) : payload.size());
    payload += array.bytes;
  }
  return Message{Frame::Copy(request.SerializeAsString()), Frame::Copy(payload)};
}

Result<std::vector<std::string>> BuildRaw(const Json& step) {
  std::vector<std::string> frames;
  for (const Json& frame : step.at("raw")) {
    const std::string bytes = FromHex((frame.is_array() ? frame.at(0) : frame).get<std::string>());
    const size_t times = frame.is_array() ? frame.at(1).get<size_t>() : 1;
    frames.emplace_back();
    for (size_t i = 0; i < times; ++i) frames.back() += bytes;
  }
  if (frames.empty()) return Mistake("a raw message without frames");
  return frames;
}

ReplyMessage ReadReply(Message message) {
  ReplyMessage reply;
  reply.unreadable = ParseEnvelope(message.envelope, &reply.envelope);
  if (!reply.unreadable.ok()) return reply;
  const Result<ArrayReader> arrays = ArrayReader::Parse(reply.envelope.arrays(), message.payload);
  reply.unreadable = arrays.status();
  if (!arrays.ok()) return reply;
  for (const pb::Array& entry : reply.envelope.arrays()) {
    const TensorView& view = *arrays->Find(entry.name());
    reply.arrays[entry.name()] = {entry.dtype(),
                                  {view.shape.begin(), view.shape.end()},
                                  {reinterpret_cast<const char*>(view.data), view.bytes()}};
  }
  return reply;
}

Status CheckReply(const Json& step, const ReplyMessage& reply, uint64_t id, const Labels& labels) {
  B4MRL_RETURN_IF_ERROR(reply.unreadable);
  const pb::Reply& envelope = reply.envelope;
  if (envelope.protocol_version() != limits::kProtocolVersion || envelope.request_id() != id) {
    return Mismatch(fmt::format("version {} and id {}, expected 1 and {}",
                                envelope.protocol_version(), envelope.request_id(), id));
  }
  const Json expected = step.value("expect", Json::object());
  const Json code = expected.value("code", Json(0));
  const int got = envelope.status().code();
  const bool allowed =
      code.is_array() ? std::count(code.begin(), code.end(), Json(got)) > 0 : code == Json(got);
  if (!allowed) {
    return Mismatch(
        fmt::format("code {}, expected {}: {}", got, code.dump(), envelope.status().message()));
  }
  B4MRL_RETURN_IF_ERROR(got == 0 ? CheckKind(step, envelope)
                                 : CheckError(envelope, reply.arrays.size()));
  return CheckExpectations(expected, reply, labels);
}

}  // namespace b4mrl::conformance

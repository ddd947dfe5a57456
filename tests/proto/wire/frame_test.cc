#include "proto/wire/frame.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "proto/base/limits.h"
#include "proto/base/rng.h"
#include "proto/wire/tensor.h"

namespace b4mrl {
namespace {

using Table = google::protobuf::RepeatedPtrField<pb::Array>;

void AddEntry(Table* table, const std::string& name, int dtype,
              std::initializer_list<uint64_t> shape, uint64_t offset) {
  pb::Array* entry = table->Add();
  entry->set_name(name);
  entry->set_dtype(static_cast<pb::DType>(dtype));
  for (const uint64_t extent : shape) entry->add_shape(extent);
  entry->set_offset(offset);
}

Status ParseStatus(const Table& table, size_t payload_size) {
  const std::vector<std::byte> payload(payload_size);
  return ArrayReader::Parse(table, payload).status();
}

Status ParseOne(int dtype, std::initializer_list<uint64_t> shape, uint64_t offset,
                size_t payload_size) {
  Table table;
  AddEntry(&table, "x", dtype, shape, offset);
  return ParseStatus(table, payload_size);
}

TEST_CASE("Arrays of every type come back as they were laid out") {
  Table table;
  ArrayLayout layout(&table);
  const size_t rewards = layout.Add("rewards", DType::kFloat64, {3});
  const size_t observations = layout.Add("observations", DType::kFloat32, {3, 5});
  const size_t flags = layout.Add("terminated", DType::kUint8, {3});
  REQUIRE(layout.payload_bytes() == 128 + 3);  // 24 and 60 bytes, each rounded up to 64
  Frame payload = layout.Allocate();
  for (size_t i = 0; i < 3; ++i) ArrayAt<double>(payload, rewards, 3)[i] = 0.5 * i;
  for (size_t i = 0; i < 15; ++i) ArrayAt<float>(payload, observations, 15)[i] = 2.f * i;
  for (size_t i = 0; i < 3; ++i) ArrayAt<uint8_t>(payload, flags, 3)[i] = 255 - i;

  const Result<ArrayReader> reader = ArrayReader::Parse(table, payload);
  REQUIRE(reader.ok());
  const auto view = reader->Require("observations", {DType::kFloat32}, {ArrayReader::kAny, 5});
  REQUIRE(view.ok());
  REQUIRE(view->rows() == 3);
  REQUIRE(view->As<float>()[14] == 28.f);
  REQUIRE(reader->Require("rewards", {DType::kFloat64}, {3})->As<double>()[2] == 1.0);
  REQUIRE(reader->Find("terminated")->As<uint8_t>()[1] == 254);
  REQUIRE_FALSE(reader->Has("truncated"));
  // Gaps between arrays are zero: equal contents are equal bytes.
  for (size_t i = 24; i < 64; ++i) REQUIRE(payload.data()[i] == std::byte{0});
  for (size_t i = 64 + 60; i < 128; ++i) REQUIRE(payload.data()[i] == std::byte{0});
}

TEST_CASE("Views of small and of unaligned payloads survive a move of their frame") {
  Table table;
  AddEntry(&table, "n", pb::UINT64, {2}, 0);
  const uint64_t values[] = {3, 1ull << 60};
  Frame small = Frame::Copy({reinterpret_cast<const char*>(values), sizeof(values)});
  const Result<ArrayReader> from_small = ArrayReader::Parse(table, small);
  const Frame moved = std::move(small);
  REQUIRE(from_small->Find("n")->As<uint64_t>()[1] == values[1]);

  std::vector<std::byte> shifted(200 + 1);
  std::memcpy(shifted.data() + 1, values, sizeof(values));
  const auto from_unaligned =
      ArrayReader::Parse(table, std::span<const std::byte>(shifted).subspan(1));
  const TensorView* view = from_unaligned->Find("n");
  REQUIRE(reinterpret_cast<uintptr_t>(view->data) % sizeof(uint64_t) == 0);
  REQUIRE(view->As<uint64_t>()[1] == values[1]);
}

TEST_CASE("Tables that lie about their payload are refused") {
  REQUIRE(ParseOne(pb::FLOAT32, {16}, 0, 64).ok());
  REQUIRE_FALSE(ParseOne(pb::FLOAT32, {17}, 0, 64).ok());
  REQUIRE_FALSE(ParseOne(pb::FLOAT32, {16}, 64, 64).ok());
  REQUIRE_FALSE(ParseOne(pb::UINT8, {1}, 128, 64).ok());
  REQUIRE_FALSE(ParseOne(pb::UINT8, {1}, UINT64_MAX - 63, 64).ok());
  REQUIRE_FALSE(ParseOne(pb::UINT8, {16}, 8, 64).ok());  // offset not a multiple of 64
  REQUIRE_FALSE(ParseOne(pb::DTYPE_UNSPECIFIED, {1}, 0, 64).ok());
  REQUIRE_FALSE(ParseOne(8, {1}, 0, 64).ok());
  REQUIRE_FALSE(ParseOne(-1, {1}, 0, 64).ok());
  REQUIRE_FALSE(ParseOne(256 + pb::FLOAT32, {1}, 0, 64).ok());
}

TEST_CASE("Shapes whose product overflows are refused") {
  REQUIRE_FALSE(ParseOne(pb::UINT8, {1ull << 32, 1ull << 32}, 0, 64).ok());
  REQUIRE_FALSE(ParseOne(pb::FLOAT64, {1ull << 61}, 0, 64).ok());
  REQUIRE_FALSE(ParseOne(pb::FLOAT32, {UINT64_MAX}, 0, 64).ok());
  REQUIRE_FALSE(ParseOne(pb::UINT8, {UINT64_MAX, UINT64_MAX}, 0, 64).ok());
  // Nothing at all is well-formed, however large the other extents are.
  REQUIRE(ParseOne(pb::UINT8, {0, UINT64_MAX}, 0, 0).ok());
}

TEST_CASE("Too many arrays, too many dimensions and repeated names are refused") {
  Table many;
  for (size_t i = 0; i <= limits::kMaxArraysPerMessage; ++i) {
    AddEntry(&many, "x" + std::to_string(i), pb::UINT8, {1}, 0);
  }
  REQUIRE_FALSE(ParseStatus(many, 64).ok());
  many.RemoveLast();
  REQUIRE(ParseStatus(many, 64).ok());
  REQUIRE(ParseOne(pb::UINT8, {1, 1, 1, 1, 1, 1, 1, 1}, 0, 64).ok());
  REQUIRE_FALSE(ParseOne(pb::UINT8, {1, 1, 1, 1, 1, 1, 1, 1, 1}, 0, 64).ok());
  Table twice;
  AddEntry(&twice, "x", pb::UINT8, {1}, 0);
  AddEntry(&twice, "x", pb::UINT8, {1}, 0);
  REQUIRE_FALSE(ParseStatus(twice, 64).ok());
}

TEST_CASE("What random tables get accepted lies inside the payload and is aligned") {
  Rng rng(1, "tables");
  size_t accepted = 0;
  const std::vector<std::byte> payload(1024);
  for (int round = 0; round < 50'000; ++round) {
    Table table;
    const uint64_t arrays = 1 + rng.Below(3);
    for (uint64_t i = 0; i < arrays; ++i) {
      pb::Array* entry = table.Add();
      entry->set_name(std::string(1, static_cast<char>('a' + rng.Below(6))));
      entry->set_dtype(static_cast<pb::DType>(rng.Below(10)));
      // Half of the numbers are small, the others of any size.
      const auto number = [&rng] { return rng.NextUint64() >> (rng.Below(2) * 56 + rng.Below(8)); };
      for (uint64_t d = rng.Below(5); d > 0; --d) entry->add_shape(number());
      entry->set_offset(rng.Below(2) == 0 ? 64 * rng.Below(20) : number());
    }
    const size_t size = rng.Below(payload.size() + 1);
    const auto reader = ArrayReader::Parse(table, std::span(payload).first(size));
    if (!reader.ok()) {
      REQUIRE(reader.status().code() == StatusCode::kInvalidArgument);
      continue;
    }
    ++accepted;
    for (const pb::Array& entry : table) {
      const TensorView* view = reader->Find(entry.name());
      REQUIRE(view != nullptr);
      REQUIRE(reinterpret_cast<uintptr_t>(view->data) % DTypeSize(view->dtype) == 0);
      REQUIRE(entry.offset() <= size);
      REQUIRE(view->bytes() <= size - entry.offset());
    }
  }
  REQUIRE(accepted > 1'000);  // the test reaches both sides
  REQUIRE(accepted < 49'000);
}

TEST_CASE("Require names what is missing, of another type or of another shape") {
  Table table;
  AddEntry(&table, "actions", pb::INT32, {4, 6}, 0);
  const std::vector<std::byte> payload(96);
  const auto reader = ArrayReader::Parse(table, payload);
  REQUIRE(reader.ok());
  REQUIRE(reader->Require("numbers", {DType::kUint64}, {4}).status().message() ==
          "array 'numbers' is missing");
  REQUIRE(
      reader->Require("actions", {DType::kFloat32, DType::kFloat64}, {4, 6}).status().message() ==
      "actions dtype is 'int32', allowed: float32 or float64");
  REQUIRE(reader->Require("actions", {DType::kInt32}, {ArrayReader::kAny, 5}).status().message() ==
          "actions shape is '(4, 6)', allowed: (any, 5)");
  REQUIRE_FALSE(reader->Require("actions", {DType::kInt32}, {24}).ok());
  REQUIRE_FALSE(reader->Require("actions", {DType::kInt32}, {4, 6, 1}).ok());
}

TEST_CASE("Envelopes above the limit and bytes that are no message are refused") {
  pb::Request request;
  request.mutable_open()->set_config(std::string(limits::kMaxEnvelopeBytes - 100, 'x'));
  Result<Frame> frame = SerializeEnvelope(request);
  REQUIRE(frame.ok());
  pb::Request back;
  REQUIRE(ParseEnvelope(*frame, &back).ok());
  REQUIRE(back.SerializeAsString() == request.SerializeAsString());

  request.mutable_open()->set_environment(std::string(100, 'x'));
  REQUIRE(SerializeEnvelope(request).status().code() == StatusCode::kLimitExceeded);
  REQUIRE(ParseEnvelope(Frame::Copy(request.SerializeAsString()), &back).code() ==
          StatusCode::kLimitExceeded);
  REQUIRE(ParseEnvelope(Frame::Copy("\xff\xff\xff"), &back).code() == StatusCode::kInvalidArgument);
  REQUIRE(ParseEnvelope(Frame(), &back).ok());  // an empty message is one without fields
}

TEST_CASE("A status crosses the wire, without the bytes that would break a reader of UTF-8") {
  pb::Status wire;
  SetStatus(Status(StatusCode::kBusy, "lane \xff\x01 7"), &wire);
  REQUIRE(wire.code() == 4);
  REQUIRE(wire.recoverable());
  REQUIRE(wire.message() == "lane ?? 7");
  REQUIRE(GetStatus(wire).code() == StatusCode::kBusy);
  SetStatus(Status(), &wire);
  REQUIRE(GetStatus(wire).ok());
  wire.set_code(-5);
  REQUIRE(GetStatus(wire).code() == StatusCode::kInternal);
}

TEST_CASE("NaN and infinity are seen anywhere in floating-point arrays") {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), HUGE_VAL, -HUGE_VAL}) {
    std::vector<double> values(9, 1.0);
    TensorView view{DType::kFloat64, {3, 3}, reinterpret_cast<const std::byte*>(values.data())};
    REQUIRE(AllFinite(view));
    for (double& value : values) {
      value = bad;
      REQUIRE_FALSE(AllFinite(view));
      value = 1.0;
    }
  }
}

TEST_CASE("A shared frame shows the same bytes after the first handle has gone") {
  Frame second;
  {
    Frame first = Frame::Copy(std::string(1000, 'b'));
    second = first.Share();
  }
  REQUIRE(second.view() == std::string(1000, 'b'));
  REQUIRE(Frame().size() == 0);
}

}  // namespace
}  // namespace b4mrl

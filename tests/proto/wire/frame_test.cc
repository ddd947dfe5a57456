#include "proto/wire/frame.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "proto/base/limits.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

using Table = google::protobuf::RepeatedPtrField<pb::Array>;

pb::Array* AddEntry(Table* table, const std::string& name, int dtype, std::vector<uint64_t> shape,
                    uint64_t offset) {
  pb::Array* entry = table->Add();
  entry->set_name(name);
  entry->set_dtype(static_cast<pb::DType>(dtype));
  entry->set_offset(offset);
  for (const uint64_t extent : shape) entry->add_shape(extent);
  return entry;
}

StatusCode Parse(const Table& table, size_t payload_bytes) {
  const std::vector<std::byte> payload(payload_bytes);
  return ArrayReader::Parse(table, payload).status().code();
}

TEST_CASE("arrays that were laid out are read back") {
  pb::Request request;
  ArrayLayout layout(request.mutable_arrays());
  const size_t actions = layout.Add("actions", DType::kFloat32, {2, 3});
  const size_t numbers = layout.Add("numbers", DType::kUint64, {2});
  CHECK(actions == 0);
  CHECK(numbers == 64);
  CHECK(layout.payload_bytes() == 80);
  Frame payload = layout.Allocate();
  std::ranges::copy(std::array{1.f, 2.f, 3.f, 4.f, 5.f, 6.f},
                    ArrayAt<float>(payload, actions, 6).begin());
  std::ranges::copy(std::array<uint64_t, 2>{7, 8}, ArrayAt<uint64_t>(payload, numbers, 2).begin());
  // The gap between them carries no old memory.
  CHECK(std::all_of(payload.data() + 24, payload.data() + 64,
                    [](std::byte b) { return b == std::byte{0}; }));

  const auto arrays = ArrayReader::Parse(request.arrays(), payload);
  REQUIRE(arrays.ok());
  const auto view = arrays->Require("actions", {DType::kFloat64, DType::kFloat32}, {2, 3});
  REQUIRE(view.ok());
  CHECK(view->As<float>()[5] == 6.f);
  CHECK(view->rows() == 2);
  CHECK(arrays->Require("numbers", {DType::kUint64}, {ArrayReader::kAny})->As<uint64_t>()[1] == 8);
  CHECK(arrays->Has("numbers"));
  CHECK_FALSE(arrays->Has("lanes"));
}

TEST_CASE("an array that is missing or of another type or shape is named") {
  pb::Request request;
  ArrayLayout layout(request.mutable_arrays());
  layout.Add("actions", DType::kFloat32, {2, 3});
  const Frame payload = layout.Allocate();
  const auto arrays = ArrayReader::Parse(request.arrays(), payload);
  REQUIRE(arrays.ok());
  CHECK(arrays->Require("lanes", {DType::kUint32}, {2}).status().message() ==
        "array 'lanes' is missing");
  CHECK(arrays->Require("actions", {DType::kFloat64}, {2, 3}).status().message() ==
        "actions dtype is 'float32', allowed: float64");
  CHECK(arrays->Require("actions", {DType::kFloat32}, {ArrayReader::kAny, 4}).status().message() ==
        "actions shape is '(2, 3)', allowed: (any, 4)");
  CHECK_FALSE(arrays->Require("actions", {DType::kFloat32}, {2}).ok());
}

TEST_CASE("tables that lie about their payload are refused") {
  Table table;
  AddEntry(&table, "a", pb::FLOAT32, {4}, 64);
  CHECK(Parse(table, 80) == StatusCode::kOk);
  CHECK(Parse(table, 79) == StatusCode::kInvalidArgument);
  CHECK(Parse(table, 0) == StatusCode::kInvalidArgument);

  const auto refused = [](int dtype, std::vector<uint64_t> shape, uint64_t offset) {
    Table one;
    AddEntry(&one, "a", dtype, std::move(shape), offset);
    return Parse(one, 4096) == StatusCode::kInvalidArgument;
  };
  CHECK(refused(0, {1}, 0));
  CHECK(refused(8, {1}, 0));
  CHECK(refused(257, {1}, 0));   // 1 in its low byte
  CHECK(refused(-255, {1}, 0));  // as well
  CHECK(refused(pb::FLOAT32, {1}, 4));
  CHECK(refused(pb::FLOAT32, {1}, ~uint64_t{63}));
  CHECK(refused(pb::FLOAT64, {uint64_t{1} << 61}, 0));                      // 2^64 bytes
  CHECK(refused(pb::UINT8, {uint64_t{1} << 32, uint64_t{1} << 32}, 0));     // 2^64 elements
  CHECK(refused(pb::UINT8, {uint64_t{1} << 63, uint64_t{1} << 63, 0}, 0));  // whatever its zero
  CHECK(refused(pb::UINT8, std::vector<uint64_t>(limits::kMaxArrayDimensions + 1, 1), 0));
  CHECK_FALSE(refused(pb::UINT8, std::vector<uint64_t>(limits::kMaxArrayDimensions, 1), 0));
  CHECK_FALSE(refused(pb::FLOAT64, {0, 17}, 4096));  // nothing, at the very end
  Table nothing;
  AddEntry(&nothing, "a", pb::FLOAT64, {0}, 0);
  CHECK(Parse(nothing, 0) == StatusCode::kOk);
}

TEST_CASE("too many arrays and repeated names are refused") {
  Table table;
  for (size_t i = 0; i < limits::kMaxArraysPerMessage; ++i) {
    AddEntry(&table, "a" + std::to_string(i), pb::UINT8, {1}, 0);
  }
  CHECK(Parse(table, 64) == StatusCode::kOk);
  AddEntry(&table, "b", pb::UINT8, {1}, 0);
  CHECK(Parse(table, 64) == StatusCode::kInvalidArgument);
  Table twice;
  AddEntry(&twice, "a", pb::UINT8, {1}, 0);
  AddEntry(&twice, "a", pb::UINT8, {1}, 0);
  CHECK(Parse(twice, 64) == StatusCode::kInvalidArgument);
}

// Extents, offsets and types that are often just right, just wrong or absurd.
Table RandomTable(Rng& rng, uint64_t payload_bytes) {
  const auto number = [&rng, payload_bytes]() -> uint64_t {
    switch (rng.Below(6)) {
      case 0:
        return rng.Below(4);
      case 1:
        return rng.Below(payload_bytes + 2);
      case 2:
        return 64 * rng.Below(payload_bytes / 64 + 2);
      case 3:
        return uint64_t{1} << rng.Below(64);
      case 4:
        return ~rng.Below(130);
      default:
        return rng.NextUint64();
    }
  };
  Table table;
  const uint64_t arrays = rng.Below(4);
  for (uint64_t i = 0; i < arrays; ++i) {
    std::vector<uint64_t> shape(rng.Below(4));
    for (uint64_t& extent : shape) extent = rng.Below(2) == 0 ? rng.Below(9) : number();
    const int dtype =
        rng.Below(8) == 0 ? static_cast<int>(rng.NextUint64()) : static_cast<int>(rng.Below(8));
    AddEntry(&table, std::string(1, static_cast<char>('a' + rng.Below(3))), dtype, shape,
             rng.Below(2) == 0 ? 64 * rng.Below(4) : number());
  }
  return table;
}

TEST_CASE("whatever a table says, accepted arrays lie within the payload and are aligned") {
  Rng rng(1, "table-fuzz");
  int accepted = 0;
  for (int i = 0; i < 100'000; ++i) {
    std::vector<std::byte> memory(rng.Below(600) + 8);
    const size_t skew = rng.Below(8);  // as in ZeroMQ's receive buffers
    const std::span<const std::byte> payload = std::span(memory).subspan(skew);
    const Table table = RandomTable(rng, payload.size());
    const auto arrays = ArrayReader::Parse(table, payload);
    if (!arrays.ok()) continue;
    accepted += table.size() > 0;
    for (const pb::Array& entry : table) {
      const TensorView* view = arrays->Find(entry.name());
      REQUIRE(view != nullptr);
      REQUIRE(reinterpret_cast<uintptr_t>(view->data) % DTypeSize(view->dtype) == 0);
      REQUIRE(entry.offset() + view->bytes() <= payload.size());
    }
  }
  CHECK(accepted > 1000);
}

TEST_CASE("views outlive the move of a small frame") {
  pb::Request request;
  ArrayLayout layout(request.mutable_arrays());
  layout.Add("x", DType::kUint64, {1});
  Frame payload = layout.Allocate();
  ArrayAt<uint64_t>(payload, 0, 1)[0] = 42;
  auto arrays = ArrayReader::Parse(request.arrays(), payload);
  REQUIRE(arrays.ok());
  const ArrayReader moved = std::move(*arrays);
  const Frame elsewhere = std::move(payload);
  payload = Frame::Copy(std::string(8, '\xff'));
  CHECK(moved.Find("x")->As<uint64_t>()[0] == 42);
}

TEST_CASE("shared frames keep their bytes when one handle goes") {
  for (const size_t size : {size_t{5}, size_t{5000}}) {
    Frame copy;
    {
      Frame original = Frame::Copy(std::string(size, 'x'));
      copy = original.Share();
    }
    CHECK(copy.view() == std::string(size, 'x'));
  }
}

TEST_CASE("envelopes are bounded both ways") {
  pb::Request request;
  request.mutable_hello()->set_client(std::string(limits::kMaxEnvelopeBytes, 'x'));
  CHECK(SerializeEnvelope(request).status().code() == StatusCode::kInvalidArgument);
  pb::Request parsed;
  const Frame large = Frame::Copy(request.SerializeAsString());
  CHECK(ParseEnvelope(large, &parsed).code() == StatusCode::kInvalidArgument);
  CHECK(ParseEnvelope(Frame::Copy("\xff\xff"), &parsed).code() == StatusCode::kInvalidArgument);
  CHECK(ParseEnvelope(Frame(), &parsed).code() == StatusCode::kInvalidArgument);

  // As many as are allowed, and one more.
  std::string text = *request.mutable_hello()->mutable_client();
  while (request.ByteSizeLong() > limits::kMaxEnvelopeBytes) {
    text.pop_back();
    request.mutable_hello()->set_client(text);
  }
  REQUIRE(request.ByteSizeLong() == limits::kMaxEnvelopeBytes);
  CHECK(SerializeEnvelope(request).ok());
  CHECK(ParseEnvelope(Frame::Copy(request.SerializeAsString()), &parsed).ok());
  request.mutable_hello()->set_client(text + "x");
  CHECK_FALSE(SerializeEnvelope(request).ok());
  CHECK_FALSE(ParseEnvelope(Frame::Copy(request.SerializeAsString()), &parsed).ok());

  request.mutable_hello()->set_client("small");
  const auto frame = SerializeEnvelope(request);
  REQUIRE(frame.ok());
  REQUIRE(ParseEnvelope(*frame, &parsed).ok());
  CHECK(parsed.hello().client() == "small");
}

TEST_CASE("a status crosses the wire, its text as printable ASCII") {
  pb::Status wire;
  SetStatus(Status(StatusCode::kBusy, "lane 3 is at it"), &wire);
  CHECK(wire.recoverable());
  CHECK(GetStatus(wire).code() == StatusCode::kBusy);
  CHECK(GetStatus(wire).message() == "lane 3 is at it");
  SetStatus(Status(StatusCode::kUnknownName, "no '\xc3\xa4\x07'"), &wire);
  CHECK(wire.message() == "no '" + std::string(3, '?') + "'");
  wire.set_code(-3);
  CHECK(GetStatus(wire).code() == StatusCode::kInternal);
  wire.set_code(0);
  CHECK(GetStatus(wire).ok());
}

}  // namespace
}  // namespace b4mrl

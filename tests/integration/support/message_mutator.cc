#include "tests/integration/support/message_mutator.h"

#include <cmath>
#include <cstring>
#include <limits>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// A lane that works on one mutant is busy for the next, and a flipped number that came out as the
// next one has moved its lane on: both are told before the damage is looked at.
const std::vector<StatusCode> kInvalid = {StatusCode::kInvalidArgument, StatusCode::kBusy,
                                          StatusCode::kStale};

bool IsLaneRequest(const pb::Request& request) {
  return request.has_step() || request.has_reset() || request.has_restore();
}

}  // namespace

const std::vector<MessageMutator::NamedDamage>& MessageMutator::Damages() {
  using M = MessageMutator;
  static const std::vector<NamedDamage> damages = {
      {"nothing", &M::Nothing},
      {"cut envelope", &M::CutEnvelope},
      {"flipped envelope", &M::FlipEnvelope},
      {"flipped envelope", &M::FlipEnvelope},
      {"random envelope", &M::RandomEnvelope},
      {"spliced envelopes", &M::SpliceEnvelopes},
      {"cut payload", &M::CutPayload},
      {"grown payload", &M::GrowPayload},
      {"flipped payload", &M::FlipPayload},
      {"random payload", &M::RandomPayload},
      {"random table", &M::RandomTable},
      {"wrong version", &M::WrongVersion},
      {"wrong token", &M::WrongToken},
      {"wrong peer", &M::WrongPeer},
      {"wrong dtype", &M::WrongDtype},
      {"repeated array", &M::RepeatedArray},
      {"overlapping arrays", &M::OverlappingArrays},
      {"missing array", &M::MissingArray},
      {"huge shape", &M::HugeShape},
      {"misaligned offset", &M::MisalignedOffset},
      {"too many arrays", &M::TooManyArrays},
      {"action that is not finite", &M::NotFiniteAction},
      {"gap in numbers", &M::GapInNumbers},
      {"stale number", &M::StaleNumber},
      {"unknown lane", &M::UnknownLane},
      {"unknown name", &M::UnknownName},
      {"too large", &M::TooLarge},
  };
  return damages;
}

Mutant MessageMutator::Next() {
  while (true) {
    const RequestTemplate& original = corpus_[rng_.Below(corpus_.size())];
    const NamedDamage& damage = Damages()[rng_.Below(Damages().size())];
    request_ = original.request;
    // Sparse, so that damage to one id does not make another's.
    request_.set_request_id(rng_.NextUint64() | 1);
    mutant_ = Mutant();
    mutant_.damage = damage.name;
    mutant_.payload = original.payload;
    mutant_.request_id = request_.request_id();
    if (!(this->*damage.apply)()) continue;
    if (mutant_.envelope.empty()) mutant_.envelope = request_.SerializeAsString();
    return std::move(mutant_);
  }
}

pb::Array* MessageMutator::FindArray(const std::string& name) {
  for (pb::Array& array : *request_.mutable_arrays()) {
    if (array.name() == name) return &array;
  }
  return nullptr;
}

void MessageMutator::FlipBits(std::string* bytes) {
  if (bytes->empty()) return;
  for (uint64_t flips = 1 + rng_.Below(8); flips > 0; --flips) {
    (*bytes)[rng_.Below(bytes->size())] ^= static_cast<char>(1 << rng_.Below(8));
  }
}

std::string MessageMutator::RandomBytes(size_t size) {
  std::string bytes(size, '\0');
  for (char& byte : bytes) byte = static_cast<char>(rng_.Below(256));
  return bytes;
}

// The envelope with its id unknown, because the damage may hit it.
std::string MessageMutator::Serialized() {
  mutant_.request_id = 0;
  return request_.SerializeAsString();
}

bool MessageMutator::Nothing() {
  Allow({StatusCode::kOk, StatusCode::kBusy});
  if (IsLaneRequest(request_)) mutant_.allowed.push_back(StatusCode::kStale);
  return true;
}

bool MessageMutator::CutEnvelope() {
  mutant_.envelope = Serialized();
  mutant_.envelope.resize(rng_.Below(mutant_.envelope.size()));
  // Without any envelope there is no message to send a second part of.
  if (mutant_.envelope.empty()) mutant_.envelope = std::string(1, '\0');
  return true;
}

bool MessageMutator::FlipEnvelope() {
  mutant_.envelope = Serialized();
  FlipBits(&mutant_.envelope);
  return true;
}

bool MessageMutator::RandomEnvelope() {
  Serialized();
  mutant_.envelope = RandomBytes(1 + rng_.Below(300));
  return true;
}

bool MessageMutator::SpliceEnvelopes() {
  const std::string head = Serialized();
  const std::string tail = corpus_[rng_.Below(corpus_.size())].request.SerializeAsString();
  mutant_.envelope =
      head.substr(0, 1 + rng_.Below(head.size())) + tail.substr(rng_.Below(tail.size()));
  return true;
}

bool MessageMutator::CutPayload() {
  if (mutant_.payload.empty()) return false;
  mutant_.payload.resize(rng_.Below(mutant_.payload.size()));
  return true;
}

bool MessageMutator::GrowPayload() {
  mutant_.payload += RandomBytes(1 + rng_.Below(200));
  return true;
}

bool MessageMutator::FlipPayload() {
  if (mutant_.payload.empty()) return false;
  FlipBits(&mutant_.payload);
  return true;
}

bool MessageMutator::RandomPayload() {
  mutant_.payload = RandomBytes(rng_.Below(600));
  return true;
}

bool MessageMutator::RandomTable() {
  if (request_.arrays_size() == 0) return false;
  pb::Array& array = *request_.mutable_arrays(static_cast<int>(rng_.Below(request_.arrays_size())));
  const auto number = [this] { return rng_.NextUint64() >> rng_.Below(64); };
  switch (rng_.Below(4)) {
    case 0:
      array.set_dtype(static_cast<pb::DType>(rng_.Below(12)));
      break;
    case 1:
      array.clear_shape();
      for (uint64_t i = rng_.Below(12); i > 0; --i) array.add_shape(number());
      break;
    case 2:
      array.set_offset(rng_.Below(2) == 0 ? 64 * rng_.Below(10) : number());
      break;
    default:
      array.set_name("x" + std::to_string(rng_.Below(10)));
  }
  return true;
}

bool MessageMutator::WrongVersion() {
  uint32_t version = static_cast<uint32_t>(rng_.NextUint64() >> rng_.Below(64));
  if (version == limits::kProtocolVersion) version = 0;
  request_.set_protocol_version(version);
  Allow({StatusCode::kVersionMismatch});
  return true;
}

bool MessageMutator::WrongToken() {
  if (!IsLaneRequest(request_) && !request_.has_query() && !request_.has_snapshot()) return false;
  request_.set_session_token(
      RandomBytes(rng_.Below(3) == 0 ? rng_.Below(40) : limits::kTokenBytes));
  Allow({StatusCode::kSessionLost});
  return true;
}

bool MessageMutator::WrongPeer() {
  const uint64_t id = request_.request_id();
  request_ = foreign_;
  request_.set_request_id(id);
  // The gateway carries on what is not for it; the right peer then misses the payload.
  Allow({StatusCode::kUnsupported, StatusCode::kInvalidArgument});
  return true;
}

bool MessageMutator::WrongDtype() {
  if (request_.arrays_size() == 0) return false;
  // No array of any request holds signed numbers.
  request_.mutable_arrays(static_cast<int>(rng_.Below(request_.arrays_size())))
      ->set_dtype(rng_.Below(2) == 0 ? pb::INT64 : pb::INT32);
  Allow(kInvalid);
  return true;
}

bool MessageMutator::RepeatedArray() {
  if (request_.arrays_size() == 0) return false;
  *request_.add_arrays() = pb::Array(request_.arrays(0));
  Allow(kInvalid);
  return true;
}

// Two arrays over the same bytes: odd, but each is well-formed.
bool MessageMutator::OverlappingArrays() {
  if (request_.arrays_size() < 2) return false;
  request_.mutable_arrays(1)->set_offset(request_.arrays(0).offset());
  return true;
}

bool MessageMutator::MissingArray() {
  for (int i = 0; i < request_.arrays_size(); ++i) {
    const std::string& name = request_.arrays(i).name();
    if (name != "numbers" && name != "actions" && name != "observations") continue;
    if (rng_.Below(2) == 0) continue;
    request_.mutable_arrays()->DeleteSubrange(i, 1);
    Allow(kInvalid);
    return true;
  }
  return false;
}

bool MessageMutator::HugeShape() {
  if (request_.arrays_size() == 0) return false;
  pb::Array& array = *request_.mutable_arrays(static_cast<int>(rng_.Below(request_.arrays_size())));
  const int axis = static_cast<int>(rng_.Below(array.shape_size()));
  array.set_shape(axis, rng_.Below(2) == 0 ? UINT64_MAX >> rng_.Below(10) : 1ull << 40);
  Allow(kInvalid);
  return true;
}

bool MessageMutator::MisalignedOffset() {
  if (request_.arrays_size() == 0) return false;
  pb::Array& array = *request_.mutable_arrays(static_cast<int>(rng_.Below(request_.arrays_size())));
  array.set_offset(array.offset() + 1 + rng_.Below(63));
  Allow(kInvalid);
  return true;
}

bool MessageMutator::TooManyArrays() {
  if (request_.arrays_size() == 0) return false;
  for (size_t i = 0; i < limits::kMaxArraysPerMessage; ++i) {
    pb::Array* array = request_.add_arrays();
    array->set_name(std::to_string(i));
    array->set_dtype(pb::UINT8);
    array->add_shape(0);
  }
  Allow(kInvalid);
  return true;
}

bool MessageMutator::NotFiniteAction() {
  pb::Array* actions = FindArray("actions");
  if (!request_.has_step() || actions == nullptr) return false;
  constexpr float kBad[] = {std::numeric_limits<float>::quiet_NaN(), HUGE_VALF, -HUGE_VALF};
  const float bad = kBad[rng_.Below(3)];
  const size_t element = rng_.Below(actions->shape(0) * actions->shape(1));
  std::memcpy(mutant_.payload.data() + actions->offset() + 4 * element, &bad, sizeof(bad));
  Allow(kInvalid);
  return true;
}

bool MessageMutator::GapInNumbers() {
  const pb::Array* numbers = FindArray("numbers");
  if (numbers == nullptr) return false;
  // No lane of the test gets as far as this.
  const uint64_t number = 1'000'000 + (rng_.NextUint64() >> (1 + rng_.Below(40)));
  const uint64_t lane = rng_.Below(numbers->shape(0));
  std::memcpy(mutant_.payload.data() + numbers->offset() + 8 * lane, &number, sizeof(number));
  Allow({StatusCode::kGap, StatusCode::kBusy, StatusCode::kStale});
  return true;
}

bool MessageMutator::StaleNumber() {
  const pb::Array* numbers = FindArray("numbers");
  if (numbers == nullptr) return false;
  std::memset(mutant_.payload.data() + numbers->offset(), 0, 8);
  Allow({StatusCode::kStale, StatusCode::kBusy});
  return true;
}

bool MessageMutator::UnknownLane() {
  const pb::Array* lanes = FindArray("lanes");
  if (lanes == nullptr) return false;
  // Out of range, or the second lane twice.
  const uint32_t lane =
      rng_.Below(2) == 0 ? 1 : static_cast<uint32_t>(1'000 + (rng_.NextUint64() >> 33));
  std::memcpy(mutant_.payload.data() + lanes->offset(), &lane, sizeof(lane));
  Allow(kInvalid);
  return true;
}

bool MessageMutator::UnknownName() {
  const std::string name = "No" + std::to_string(rng_.Below(1'000'000));
  if (request_.has_open()) {
    // The token of an open session is refused for contents that are not its own.
    request_.set_session_token(RandomBytes(limits::kTokenBytes));
    if (rng_.Below(2) == 0) {
      request_.mutable_open()->set_environment(name);
    } else {
      request_.mutable_open()->add_perturbations()->set_name(name);
    }
  } else if (request_.has_open_dataset()) {
    if (rng_.Below(2) == 0) {
      request_.mutable_open_dataset()->set_dataset(name);
    } else {
      request_.mutable_open_dataset()->add_corruptions()->set_name(name);
    }
  } else if (request_.has_sample()) {
    request_.mutable_sample()->set_fingerprint(name);
  } else if (request_.has_read()) {
    request_.mutable_read()->set_fingerprint(name);
  } else {
    return false;
  }
  Allow({StatusCode::kUnknownName});
  return true;
}

bool MessageMutator::TooLarge() {
  if (request_.has_open()) {
    request_.set_session_token(RandomBytes(limits::kTokenBytes));
    request_.mutable_open()->set_num_envs(limits::kMaxLanesPerSession + 1 +
                                          static_cast<uint32_t>(rng_.Below(1u << 31)));
  } else if (request_.has_sample()) {
    request_.mutable_sample()->set_rows(limits::kMaxRowsPerBatch + 1 +
                                        static_cast<uint32_t>(rng_.Below(1u << 31)));
  } else if (request_.has_read()) {
    request_.mutable_read()->set_rows(limits::kMaxRowsPerBatch + 1 +
                                      static_cast<uint32_t>(rng_.Below(1u << 31)));
  } else {
    return false;
  }
  Allow({StatusCode::kInvalidArgument});
  return true;
}

}  // namespace b4mrl

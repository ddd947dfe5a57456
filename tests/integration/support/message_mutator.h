// Well-formed requests and many ways to spoil them.
//
// Blind damage (cut, flipped and random bytes, random tables) may come out as anything, a
// well-formed request included, so any reply will do. Aimed damage is one definite mistake, and the
// reply must have one of its codes. Every mutant that still parses has an id of its own. Thread
// rule: one thread. Equal seeds give equal mutants.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/rng.h"
#include "proto/base/status.h"

namespace b4mrl {

struct RequestTemplate {
  pb::Request request;
  std::string payload;
};

struct Mutant {
  std::string damage;  // for messages of the test
  std::string envelope;
  std::string payload;
  uint64_t request_id = 0;          // 0: the envelope may not parse
  std::vector<StatusCode> allowed;  // empty: any
};

class MessageMutator {
 public:
  // `corpus`: well-formed requests to one peer, which answers them with OK. `foreign`: one that the
  // peer does not answer at all.
  MessageMutator(std::vector<RequestTemplate> corpus, pb::Request foreign, uint64_t seed)
      : corpus_(std::move(corpus)), foreign_(std::move(foreign)), rng_(seed, "mutants") {}

  Mutant Next();

 private:
  // Each spoils `request_` and `mutant_`, or returns false where the damage does not apply.
  using Damage = bool (MessageMutator::*)();
  struct NamedDamage {
    const char* name;
    Damage apply;
  };
  static const std::vector<NamedDamage>& Damages();

  bool Nothing();
  bool CutEnvelope();
  bool FlipEnvelope();
  bool RandomEnvelope();
  bool SpliceEnvelopes();
  bool CutPayload();
  bool GrowPayload();
  bool FlipPayload();
  bool RandomPayload();
  bool RandomTable();
  bool WrongVersion();
  bool WrongToken();
  bool WrongPeer();
  bool WrongDtype();
  bool RepeatedArray();
  bool OverlappingArrays();
  bool MissingArray();
  bool HugeShape();
  bool MisalignedOffset();
  bool TooManyArrays();
  bool NotFiniteAction();
  bool GapInNumbers();
  bool StaleNumber();
  bool UnknownLane();
  bool UnknownName();
  bool TooLarge();

  // The array `name` of request_, or null.
  pb::Array* FindArray(const std::string& name);
  void Allow(std::vector<StatusCode> codes) { mutant_.allowed = std::move(codes); }
  void FlipBits(std::string* bytes);
  std::string RandomBytes(size_t size);
  std::string Serialized();

  std::vector<RequestTemplate> corpus_;
  pb::Request foreign_;
  Rng rng_;
  pb::Request request_;
  Mutant mutant_;
};

}  // namespace b4mrl

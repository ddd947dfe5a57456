#include "server/highway/numpy_random.h"

#include <bit>

namespace b4mrl {
namespace {

// SeedSequence's hash of one word at a time; its running constant makes equal words different.
class WordHash {
 public:
  WordHash(uint32_t start, uint32_t multiplier) : constant_(start), multiplier_(multiplier) {}

  uint32_t operator()(uint32_t word) {
    word ^= constant_;
    constant_ *= multiplier_;
    word *= constant_;
    return word ^ (word >> 16);
  }

 private:
  uint32_t constant_;
  uint32_t multiplier_;
};

uint32_t Mix(uint32_t x, uint32_t y) {
  const uint32_t mixed = 0xca01f9ddu * x - 0x4973f715u * y;
  return mixed ^ (mixed >> 16);
}

// SeedSequence(seed).generate_state(4, uint64). A 64-bit seed never has more words than the pool.
std::array<uint64_t, 4> GenerateState(uint64_t seed) {
  WordHash fill(0x43b0d7e5u, 0x931e8875u);
  std::array<uint32_t, 4> pool = {static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32)};
  for (uint32_t& word : pool) word = fill(word);
  for (size_t from = 0; from < pool.size(); ++from) {
    for (size_t to = 0; to < pool.size(); ++to) {
      if (from != to) pool[to] = Mix(pool[to], fill(pool[from]));
    }
  }
  WordHash draw(0x8b51f9ddu, 0x58f38dedu);
  std::array<uint64_t, 4> state;
  for (size_t i = 0; i < state.size(); ++i) {
    const uint64_t low = draw(pool[2 * i % pool.size()]);
    const uint64_t high = draw(pool[(2 * i + 1) % pool.size()]);
    state[i] = low | high << 32;
  }
  return state;
}

__extension__ using Uint128 = unsigned __int128;
constexpr Uint128 kMultiplier =
    Uint128{2549297995355413924ull} << 64 | Uint128{4865540595714422341ull};

}  // namespace

Pcg64::Pcg64(uint64_t seed) {
  const std::array<uint64_t, 4> words = GenerateState(seed);
  increment_ = (Uint128{words[2]} << 64 | words[3]) << 1 | 1;
  state_ = increment_;  // state 0, advanced by one draw
  state_ += Uint128{words[0]} << 64 | words[1];
  state_ = state_ * kMultiplier + increment_;
}

uint64_t Pcg64::Next() {
  state_ = state_ * kMultiplier + increment_;
  const uint64_t high = static_cast<uint64_t>(state_ >> 64);
  return std::rotr(high ^ static_cast<uint64_t>(state_), static_cast<int>(high >> 58));
}

void Pcg64::Advance(uint64_t draws) {
  // Squares the affine map of one draw again and again.
  Uint128 multiplier = kMultiplier, increment = increment_;
  for (; draws > 0; draws >>= 1) {
    if (draws & 1) state_ = state_ * multiplier + increment;
    increment *= multiplier + 1;
    multiplier *= multiplier;
  }
}

double NumpyRandom::Uniform(double low, double high) {
  return low + (high - low) * (static_cast<double>(generator_.Next() >> 11) * 0x1p-53);
}

uint32_t NumpyRandom::NextWord() {
  if (kept_word_.has_value()) {
    const uint32_t word = *kept_word_;
    kept_word_.reset();
    return word;
  }
  const uint64_t draw = generator_.Next();
  kept_word_ = static_cast<uint32_t>(draw >> 32);
  return static_cast<uint32_t>(draw);
}

uint32_t NumpyRandom::Below(uint32_t bound) {
  if (bound <= 1) return 0;
  // Lemire's multiplication with rejection.
  uint64_t product = uint64_t{NextWord()} * bound;
  if (static_cast<uint32_t>(product) < bound) {
    const uint32_t threshold = (UINT32_MAX - (bound - 1)) % bound;
    while (static_cast<uint32_t>(product) < threshold) product = uint64_t{NextWord()} * bound;
  }
  return static_cast<uint32_t>(product >> 32);
}

void NumpyRandom::Skip(uint64_t doubles, uint64_t words, uint64_t doubles_after_last_word) {
  const uint64_t draws = doubles + (words + 1) / 2;
  kept_word_.reset();
  if (words % 2 == 0) {
    generator_.Advance(draws);
    return;
  }
  generator_.Advance(draws - 1 - doubles_after_last_word);
  NextWord();  // uses the lower half and keeps the upper half
  generator_.Advance(doubles_after_last_word);
}

}  // namespace b4mrl

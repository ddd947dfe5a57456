// NumPy's default generator, bit for bit: PCG64 seeded by SeedSequence, with the draws that
// highway-env makes at a reset. An episode's position in the stream is found by jumping, so nothing
// needs to remember a generator between resets.
// Sources: O'Neill, "PCG: a family of simple fast space-efficient statistically good algorithms for
// random number generation" (2014); Brown, "Random number generation with arbitrary strides"
// (1994); NumPy's documentation of SeedSequence and Generator.
#pragma once

#include <cstdint>
#include <optional>

namespace b4mrl {

// PCG XSL RR 128/64. A value type; one thread.
class Pcg64 {
 public:
  // Seeds the generator as numpy.random.PCG64(seed) does.
  explicit Pcg64(uint64_t seed);

  uint64_t Next();
  // Changes the state as `draws` calls of Next would.
  void Advance(uint64_t draws);

 private:
  __extension__ using Uint128 = unsigned __int128;
  Uint128 state_ = 0;
  Uint128 increment_ = 0;
};

// numpy.random.default_rng(seed). A value type; one thread.
class NumpyRandom {
 public:
  explicit NumpyRandom(uint64_t seed) : generator_(seed) {}

  // Uniform in [low, high).
  double Uniform(double low, double high);
  // Uniform in [0, bound). A bound of 1 draws nothing.
  uint32_t Below(uint32_t bound);

  // Skips `doubles` calls of Uniform and `words` calls of Below, `doubles_after_last_word` of the
  // calls of Uniform after the last of Below. Below takes two numbers from each 64-bit draw. It is
  // taken to have rejected none, which happens with probability bound / 2^32 a call.
  void Skip(uint64_t doubles, uint64_t words, uint64_t doubles_after_last_word);

 private:
  uint32_t NextWord();

  Pcg64 generator_;
  std::optional<uint32_t> kept_word_;  // the upper half of a draw whose lower half was used
};

}  // namespace b4mrl

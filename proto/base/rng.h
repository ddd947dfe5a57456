// Counter-based random numbers: every draw is a pure function of (seed, purpose, stream, position).
//
// Philox-4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011) under a
// key made from a seed and a purpose. Because a position can be addressed directly, noise for one
// step, row or lane can be drawn anywhere, in any order, by any thread, with equal bytes. Uniform
// and normal variates are our own, since those of standard libraries differ. No function called
// here has a last bit that depends on the processor. Thread rule: an Rng belongs to one thread;
// copies are independent and cheap.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

namespace b4mrl {

// Mixes two numbers into a well-spread third (splitmix64's finaliser over their sum).
uint64_t MixSeeds(uint64_t a, uint64_t b);

// The generator's block function: four words from a counter and a key. Public so that tests can
// compare it with the published known answers.
std::array<uint32_t, 4> Philox4x32(std::array<uint32_t, 4> counter, std::array<uint32_t, 2> key);

// The FNV-1a hash of a name, by which a readable string can name a purpose.
constexpr uint64_t HashName(std::string_view name) {
  uint64_t hash = 0xcbf29ce484222325ull;
  for (const char c : name) {
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ull;
  }
  return hash;
}

// A number in (0, 1), never 0 or 1, from the upper 53 of 64 random bits.
double OpenUniform(uint64_t bits);

class Rng {
 public:
  // `seed`: the run's, lane's or dataset's own seed; `purpose`: what the numbers are for ("reset",
  // "obs-noise", "policy"); `stream`: which of many equal uses (episode, batch, draw).
  Rng(uint64_t seed, std::string_view purpose, uint64_t stream = 0);

  uint64_t NextUint64();
  // Uniform in [0, 1) with 53 random bits.
  double Uniform();
  // Uniform in [low, high).
  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }
  // Standard normal, from exactly one 64-bit draw, by inversion of the distribution function.
  double Normal();
  // Uniform in [0, bound), bound > 0, from exactly one 64-bit draw (bias below bound / 2^64).
  uint64_t Below(uint64_t bound);
  void FillNormal(std::span<float> out);
  void FillNormal(std::span<double> out);

  // The position in the stream, in 64-bit draws; Seek sets the position of the next draw.
  uint64_t position() const { return position_; }
  void Seek(uint64_t position) { position_ = position; }

 private:
  std::array<uint32_t, 2> key_;
  uint64_t stream_;
  uint64_t position_ = 0;
  uint64_t cached_block_ = UINT64_MAX;  // the block of two draws in cache_, if any
  std::array<uint64_t, 2> cache_{};
};

// The standard normal quantile of p in (0, 1): Wichura's AS 241 (PPND16), relative error about
// 1e-16.
double NormalQuantile(double p);

}  // namespace b4mrl

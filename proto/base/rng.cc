#include "proto/base/rng.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace b4mrl {
namespace {

// Philox-4x32: round multipliers and key increments of the paper, section 4.3.
constexpr uint32_t kMultiplier0 = 0xD2511F53u;
constexpr uint32_t kMultiplier1 = 0xCD9E8D57u;
constexpr uint32_t kWeyl0 = 0x9E3779B9u;
constexpr uint32_t kWeyl1 = 0xBB67AE85u;

uint64_t Finalize(uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

// A polynomial of a length known at compile time, so that its loop unrolls and passes over blocks
// of arguments vectorise.
template <size_t kLength>
double Polynomial(const double (&coefficients)[kLength], double x) {
  double sum = 0;
  for (size_t i = kLength; i-- > 0;) sum = sum * x + coefficients[i];
  return sum;
}

// Natural logarithm of a normal number in (0, 1) from basic arithmetic only: glibc's picks an FMA
// variant at run time, and noise must not depend on that. log x = k log 2 + 2 atanh((m - 1) /
// (m + 1)) with x = 2^k m and m near 1, read from the bits of x without a branch.
double Log(double x) {
  static constexpr double kSeries[] = {1.0,      1.0 / 3,  1.0 / 5,  1.0 / 7,  1.0 / 9,
                                       1.0 / 11, 1.0 / 13, 1.0 / 15, 1.0 / 17, 1.0 / 19,
                                       1.0 / 21, 1.0 / 23, 1.0 / 25};
  constexpr auto kLowest = std::bit_cast<uint64_t>(0.70710678118654752);  // smallest m
  const uint64_t bits = std::bit_cast<uint64_t>(x), above = bits - kLowest;
  const auto mantissa = std::bit_cast<double>(bits - (above & 0xfff0000000000000));
  const int32_t exponent = static_cast<int32_t>(above >> 32) >> 20;
  const double t = (mantissa - 1) / (mantissa + 1);
  return exponent * 0.69314718055994530942 + 2 * t * Polynomial(kSeries, t * t);
}

// Bounds of AS 241's central region, |q| = |p - 1/2| <= kCentral, and of its near tail.
constexpr double kCentral = 0.425;
constexpr double kNearTail = 5;

double CentralQuantile(double q) {
  static constexpr double kA[] = {3.3871328727963666080e0, 1.3314166789178437745e2,
                                  1.9715909503065514427e3, 1.3731693765509461125e4,
                                  4.5921953931549871457e4, 6.7265770927008700853e4,
                                  3.3430575583588128105e4, 2.5090809287301226727e3};
  static constexpr double kB[] = {1.0,
                                  4.2313330701600911252e1,
                                  6.8718700749205790830e2,
                                  5.3941960214247511077e3,
                                  2.1213794301586595867e4,
                                  3.9307895800092710610e4,
                                  2.8729085735721942674e4,
                                  5.2264952788528545610e3};
  const double r = 0.180625 - q * q;  // kCentral squared
  return q * Polynomial(kA, r) / Polynomial(kB, r);
}

// AS 241's quantiles of the two tails as functions of r = sqrt(-log(min(p, 1 - p))): NearTail for r
// up to kNearTail, FarTail beyond.
double NearTail(double r) {
  static constexpr double kC[] = {1.42343711074968357734e0,  4.63033784615654529590e0,
                                  5.76949722146069140550e0,  3.64784832476320460504e0,
                                  1.27045825245236838258e0,  2.41780725177450611770e-1,
                                  2.27238449892691845833e-2, 7.74545014278341407640e-4};
  static constexpr double kD[] = {1.0,
                                  2.05319162663775882187e0,
                                  1.67638483018380384940e0,
                                  6.89767334985100004550e-1,
                                  1.48103976427480074590e-1,
                                  1.51986665636164571966e-2,
                                  5.47593808499534494600e-4,
                                  1.05075007164441684324e-9};
  r -= 1.6;
  return Polynomial(kC, r) / Polynomial(kD, r);
}

double FarTail(double r) {
  static constexpr double kE[] = {6.65790464350110377720e0,  5.46378491116411436990e0,
                                  1.78482653991729133580e0,  2.96560571828504891230e-1,
                                  2.65321895265761230930e-2, 1.24266094738807843860e-3,
                                  2.71155556874348757815e-5, 2.01033439929228813265e-7};
  static constexpr double kF[] = {1.0,
                                  5.99832206555887937690e-1,
                                  1.36929880922735805310e-1,
                                  1.48753612908506148525e-2,
                                  7.86869131145613259100e-4,
                                  1.84631831751005468180e-5,
                                  1.42151175831644588870e-7,
                                  2.04426310338993978564e-15};
  r -= kNearTail;
  return Polynomial(kE, r) / Polynomial(kF, r);
}

double TailRadius(double p) { return std::sqrt(-Log(std::min(p, 1 - p))); }

double TailQuantile(double p) {
  const double r = TailRadius(p);
  const double x = r <= kNearTail ? NearTail(r) : FarTail(r);
  return p < 0.5 ? -x : x;
}

// The words of many Philox counters: words[i][lane].
template <size_t kLanes>
using Counters = std::array<std::array<uint32_t, kLanes>, 4>;

// Philox's ten rounds over the first `lanes` counters.
template <size_t kLanes>
void PhiloxRounds(Counters<kLanes>& words, size_t lanes, std::array<uint32_t, 2> key) {
  for (int round = 0; round < 10; ++round) {
    for (size_t i = 0; i < lanes; ++i) {
      const uint64_t product0 = static_cast<uint64_t>(kMultiplier0) * words[0][i];
      const uint64_t product1 = static_cast<uint64_t>(kMultiplier1) * words[2][i];
      words[0][i] = static_cast<uint32_t>(product1 >> 32) ^ words[1][i] ^ key[0];
      words[1][i] = static_cast<uint32_t>(product1);
      words[2][i] = static_cast<uint32_t>(product0 >> 32) ^ words[3][i] ^ key[1];
      words[3][i] = static_cast<uint32_t>(product0);
    }
    key[0] += kWeyl0;
    key[1] += kWeyl1;
  }
}

// Draws per block of FillNormal. A block is computed in passes without branches, which vectorise,
// and has the bits that successive calls of Normal() give.
constexpr size_t kBlock = 128;

// Writes draws [first, first + count) of a stream as numbers in (0, 1); `first` is even. If `count`
// is odd, the next draw is written, too.
void DrawUniforms(std::array<uint32_t, 2> key, uint64_t stream, uint64_t first, size_t count,
                  std::span<double, kBlock> out) {
  Counters<kBlock / 2> words;
  const size_t lanes = (count + 1) / 2;
  for (size_t i = 0; i < lanes; ++i) {
    const uint64_t block = first / 2 + i;
    words[0][i] = static_cast<uint32_t>(block);
    words[1][i] = static_cast<uint32_t>(block >> 32);
    words[2][i] = static_cast<uint32_t>(stream);
    words[3][i] = static_cast<uint32_t>(stream >> 32);
  }
  PhiloxRounds(words, lanes, key);
  for (size_t i = 0; i < lanes; ++i) {
    out[2 * i] = OpenUniform(words[0][i] | static_cast<uint64_t>(words[1][i]) << 32);
    out[2 * i + 1] = OpenUniform(words[2][i] | static_cast<uint64_t>(words[3][i]) << 32);
  }
}

// Computes all quantiles by the central region's formula, which holds for 85 of 100, then replaces
// the quantiles of the tails.
void Quantiles(std::span<const double> p, std::span<double, kBlock> x) {
  std::array<double, kBlock> tails, radii;
  std::array<uint8_t, kBlock> places;
  for (size_t i = 0; i < p.size(); ++i) x[i] = CentralQuantile(p[i] - 0.5);
  size_t tail_count = 0;
  for (size_t i = 0; i < p.size(); ++i) {
    tails[tail_count] = p[i];
    places[tail_count] = static_cast<uint8_t>(i);
    tail_count += std::abs(p[i] - 0.5) > kCentral ? 1 : 0;
  }
  for (size_t i = 0; i < tail_count; ++i) radii[i] = TailRadius(tails[i]);
  for (size_t i = 0; i < tail_count; ++i) {
    const double quantile = NearTail(radii[i]);
    tails[i] = tails[i] < 0.5 ? -quantile : quantile;
  }
  for (size_t i = 0; i < tail_count; ++i) {
    x[places[i]] = radii[i] <= kNearTail ? tails[i] : TailQuantile(p[places[i]]);
  }
}

template <typename Scalar>
void FillNormals(std::array<uint32_t, 2> key, uint64_t stream, uint64_t position,
                 std::span<Scalar> out) {
  std::array<double, kBlock> p, x;
  while (!out.empty()) {
    const size_t skipped = position % 2;  // draws skipped in the first Philox block
    const size_t count = std::min(kBlock - skipped, out.size());
    DrawUniforms(key, stream, position - skipped, skipped + count, p);
    Quantiles(std::span(p).subspan(skipped, count), x);
    for (size_t i = 0; i < count; ++i) out[i] = static_cast<Scalar>(x[i]);
    out = out.subspan(count);
    position += count;
  }
}

}  // namespace

std::array<uint32_t, 4> Philox4x32(std::array<uint32_t, 4> counter, std::array<uint32_t, 2> key) {
  Counters<1> words = {{{counter[0]}, {counter[1]}, {counter[2]}, {counter[3]}}};
  PhiloxRounds(words, 1, key);
  return {words[0][0], words[1][0], words[2][0], words[3][0]};
}

uint64_t MixSeeds(uint64_t a, uint64_t b) {
  return Finalize(Finalize(a + 0x9e3779b97f4a7c15ull) + b + 0x9e3779b97f4a7c15ull);
}

Rng::Rng(uint64_t seed, std::string_view purpose, uint64_t stream) : stream_(stream) {
  const uint64_t key = MixSeeds(seed, HashName(purpose));
  key_ = {static_cast<uint32_t>(key), static_cast<uint32_t>(key >> 32)};
}

uint64_t Rng::NextUint64() {
  const uint64_t block = position_ >> 1;
  if (block != cached_block_) {
    const auto words =
        Philox4x32({static_cast<uint32_t>(block), static_cast<uint32_t>(block >> 32),
                    static_cast<uint32_t>(stream_), static_cast<uint32_t>(stream_ >> 32)},
                   key_);
    cache_ = {words[0] | static_cast<uint64_t>(words[1]) << 32,
              words[2] | static_cast<uint64_t>(words[3]) << 32};
    cached_block_ = block;
  }
  return cache_[position_++ & 1];
}

double Rng::Uniform() { return static_cast<double>(NextUint64() >> 11) * 0x1p-53; }

double OpenUniform(uint64_t bits) {
  // The midpoint of one of 2^53 cells. Midpoints above one half are rounded to 53 bits; that of the
  // last cell would become 1, which has no quantile.
  const double midpoint = (static_cast<double>(bits >> 11) + 0.5) * 0x1p-53;
  return std::min(midpoint, 1 - 0x1p-53);
}

double Rng::Normal() { return NormalQuantile(OpenUniform(NextUint64())); }

uint64_t Rng::Below(uint64_t bound) {
  __extension__ using Uint128 = unsigned __int128;
  return static_cast<uint64_t>((static_cast<Uint128>(NextUint64()) * bound) >> 64);
}

void Rng::FillNormal(std::span<float> out) {
  FillNormals(key_, stream_, position_, out);
  position_ += out.size();
}

void Rng::FillNormal(std::span<double> out) {
  FillNormals(key_, stream_, position_, out);
  position_ += out.size();
}

double NormalQuantile(double p) {
  const double q = p - 0.5;
  return std::abs(q) <= kCentral ? CentralQuantile(q) : TailQuantile(p);
}

}  // namespace b4mrl

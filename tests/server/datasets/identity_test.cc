#include "server/datasets/identity.h"

#include <catch2/catch.hpp>

#include "data/files/file_hash.h"

namespace b4mrl {
namespace {

TEST_CASE("fingerprints of imports depend on environment, columns and statistics") {
  const std::string a(64, 'a'), b(64, 'b');
  const std::string one = ImportedFingerprint("HalfCheetah-v0", a, {{"mean", "1"}});
  CHECK(IsHash128(one));
  CHECK(one == ImportedFingerprint("HalfCheetah-v0", a, {{"mean", "1"}}));
  CHECK(one != ImportedFingerprint("HalfCheetah-v1", a, {{"mean", "1"}}));
  CHECK(one != ImportedFingerprint("HalfCheetah-v0", b, {{"mean", "1"}}));
  CHECK(one != ImportedFingerprint("HalfCheetah-v0", a, {{"mean", "2"}}));
  // A value cannot pass for two properties.
  CHECK(ImportedFingerprint("", a, {{"a", "1"}, {"b", "2"}}) !=
        ImportedFingerprint("", a, {{"a", "1\nb=2"}}));
}

TEST_CASE("fingerprints of derived datasets depend on source, corruptions, seed, rule and hiding") {
  constexpr TransitionRule kStored = TransitionRule::kStored, kD4rl = TransitionRule::kD4rl;
  const std::string a(32, 'a'), b(32, 'b');
  CHECK(DerivedFingerprint(a, {"", 0, kStored}) == a);
  const std::string noisy = DerivedFingerprint(a, {"obs-noise=1", 0, kStored});
  CHECK(IsHash128(noisy));
  CHECK(noisy != a);
  CHECK(noisy != DerivedFingerprint(b, {"obs-noise=1", 0, kStored}));
  CHECK(noisy != DerivedFingerprint(a, {"obs-noise=2", 0, kStored}));
  CHECK(noisy != DerivedFingerprint(a, {"obs-noise=1", 1, kStored}));
  CHECK(noisy != DerivedFingerprint(a, {"obs-noise=1", 0, kD4rl}));
  CHECK(noisy != DerivedFingerprint(a, {"obs-noise=1", 0, kStored, {9}}));
  CHECK(DerivedFingerprint(a, {"", 0, kD4rl}) != a);
}

TEST_CASE("noise matrices are named by environment and columns") {
  const std::string a(64, 'a'), b(64, 'b');
  CHECK(VersionedEnvironment("HalfCheetah") == "HalfCheetah-v0");
  CHECK(VersionedEnvironment("Swimmer") == "Swimmer");
  CHECK(NoiseMatrix("HalfCheetah-v0", a) == NoiseMatrix("HalfCheetah-v0", a));
  CHECK(NoiseMatrix("HalfCheetah-v0", a) != NoiseMatrix("HalfCheetah-v0", b));
  CHECK(NoiseMatrix("HalfCheetah-v0", a) != NoiseMatrix("Walker2d-v0", a));
}

}  // namespace
}  // namespace b4mrl

// What identifies a dataset and its noise: its rows, and the environment in which they were
// recorded. Neither depends on the file's name, its metadata, its compression or its transition
// rule's name, so a file that is written again with equal rows is the same dataset.
//
// A fingerprint, 32 hexadecimal digits, names a column cache: a hash of all that the cache serves.
// Pure functions; any thread.
#pragma once

#include <cstdint>
#include <string>

#include "data/columns/column_cache.h"
#include "data/columns/episodes.h"

namespace b4mrl {

// "HalfCheetah-v0" for "HalfCheetah"; an environment that the daemon does not know has no version.
std::string VersionedEnvironment(const std::string& environment);

// The fingerprint of an imported dataset, from its environment with version, the hash of its
// columns, and the cache's properties. The properties are in it because a crafted file may control
// what the importer writes: statistics that do not fit the columns belong to another fingerprint.
std::string ImportedFingerprint(const std::string& environment, const std::string& columns_sha256,
                                const CacheProperties& properties);

// The fingerprint of what `corruptions`, in parametric form, and then `rule` make of a dataset.
// Without corruptions and under the rule stored, it is the dataset's own. `seed` is 0 where the
// corruptions draw no numbers.
std::string DerivedFingerprint(const std::string& fingerprint, const std::string& corruptions,
                               uint64_t seed, TransitionRule rule);

// Which noise matrix the dataset has (DrawContext::major), from its environment with version and
// the hash of its columns.
uint64_t NoiseMatrix(const std::string& environment, const std::string& columns_sha256);

}  // namespace b4mrl

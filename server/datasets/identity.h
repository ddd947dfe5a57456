// What identifies a dataset and its noise: its rows, and the environment in which they were
// recorded. Neither depends on the file's name, its compression or its transition rule's name, so a
// file that is written again with equal rows is the same dataset. Of its metadata, only the hidden
// dimensions count, where noise would fall on them.
//
// A fingerprint, 32 hexadecimal digits, names a column cache: a hash of all that the cache serves.
// Pure functions; any thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

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

// What is made of a dataset: its rows corrupted, then read by the rule.
struct DerivedRows {
  std::string corruptions;  // in parametric form
  uint64_t seed = 0;        // 0 where the corruptions draw no numbers
  TransitionRule rule = TransitionRule::kStored;
  // Dimensions that the dataset hides, which stay 0 under noise: a file with equal rows need not
  // say that it hides them. Empty where the corruptions draw no numbers.
  std::vector<uint32_t> hidden = {};
};
// Its fingerprint; the dataset's own where nothing changes.
std::string DerivedFingerprint(const std::string& fingerprint, const DerivedRows& rows);

// Which noise matrix the dataset has (DrawContext::major), from its environment with version and
// the hash of its columns.
uint64_t NoiseMatrix(const std::string& environment, const std::string& columns_sha256);

}  // namespace b4mrl

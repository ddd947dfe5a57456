// A dataset's provenance as JSON: in the importer's answer and in the index of imported files.
// Texts come from a file, which may hold any bytes; in JSON they are printable. Pure functions; any
// thread.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "data/d4rl/dataset_provenance.h"
#include "proto/base/status.h"

namespace b4mrl {

// The first `max_bytes` of a text, with '?' for every byte that is not printable ASCII.
std::string PlainText(const std::string& text, size_t max_bytes);
// A text about a behaviour policy as replies and listings show it: at most 200 characters.
std::string PlainPolicy(const std::string& text);

nlohmann::json ToJson(const DatasetProvenance& provenance);
// kDataLoss if the JSON is not what ToJson gives for a valid provenance.
Result<DatasetProvenance> ProvenanceOf(const nlohmann::json& json);

}  // namespace b4mrl

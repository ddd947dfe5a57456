// Gives a cache's manifest another schema and the right hash for it, as a later version would.
#pragma once

#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "data/files/file_hash.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

inline void ChangeManifestSchema(const std::string& path, int schema) {
  nlohmann::json manifest = nlohmann::json::parse(ReadBytes(path));
  manifest["schema"] = schema;
  manifest.erase("hash");
  const std::string text = manifest.dump();
  StreamHash hash;
  hash.Update(std::as_bytes(std::span(text)));
  manifest["hash"] = hash.Hex();
  WriteBytes(path, manifest.dump());
}

}  // namespace b4mrl

// Changes a cache's manifest and gives it the right hash, as another version of the program or a
// crafted file would.
#pragma once

#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "data/files/file_hash.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

template <typename Change>
void ChangeManifest(const std::string& path, const Change& change) {
  nlohmann::json manifest = nlohmann::json::parse(ReadBytes(path));
  change(manifest);
  manifest.erase("hash");
  const std::string text = manifest.dump();
  StreamHash hash;
  hash.Update(std::as_bytes(std::span(text)));
  manifest["hash"] = hash.Hex();
  WriteBytes(path, manifest.dump());
}

inline void ChangeManifestSchema(const std::string& path, int schema) {
  ChangeManifest(path, [schema](nlohmann::json& manifest) { manifest["schema"] = schema; });
}

}  // namespace b4mrl

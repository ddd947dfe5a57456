// The catalogue: all environments and perturbations, and the models of users. A client asks for it
// page by page, as it may be longer than an envelope.
//
// To put the catalogue together takes milliseconds, and it changes only with the models folder, so
// its entries are kept in serialised form. Thread rule: the gateway's main thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/limits.h"

namespace b4mrl {

class Catalogue {
 public:
  // The envelope of a page takes at most `page_bytes`. An entry that takes more by itself is left
  // out, and an error is logged.
  explicit Catalogue(std::string models_folder, size_t page_bytes = limits::kMaxEnvelopeBytes);

  // Makes `reply` carry the entries from number `first` on, as many as fit a page. Environments
  // come first, then perturbations. The entries stand in the reply as bytes, which are written to
  // the envelope as they are: `reply->catalogue()` is empty until the envelope is parsed.
  void FillPage(uint32_t first, pb::Reply* reply);

 private:
  // Lists the models folder, unless its time of change shows that the list is still right.
  void ReadFolder();
  void Serialise();

  const std::string models_folder_;
  const size_t page_bytes_;  // of all entries of a page
  std::vector<std::string> files_;
  std::optional<int64_t> folder_changed_ns_;  // when files_ was read; unset if it may be outdated
  std::vector<std::string> entries_;          // each a serialised CatalogueReply of one entry
};

}  // namespace b4mrl

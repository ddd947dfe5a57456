// The catalogue: all environments and perturbations, the models of users and, for clients that ask
// for them, all benchmarks. A client asks for it page by page, as it may be longer than an
// envelope.
//
// To put the catalogue together takes milliseconds, and it changes only with the models folder, so
// its entries are kept in serialised form. Benchmarks are read when they are first asked for: most
// daemons serve one learner, which asks for none. Thread rule: the gateway's main thread.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "data/suites/suites.h"
#include "proto/b4mrl.pb.h"
#include "proto/base/limits.h"
#include "server/gateway/folder_look.h"

namespace b4mrl {

class Catalogue {
 public:
  // The envelope of a page takes at most `page_bytes`. An entry that takes more by itself is left
  // out, and an error is logged.
  // `read_benchmarks` is called at most once.
  Catalogue(const std::string& models_folder,
            std::function<std::vector<Benchmark>()> read_benchmarks,
            size_t page_bytes = limits::kMaxEnvelopeBytes);

  // Makes `reply` carry the entries from number request.first() on, as many as fit a page.
  // Environments come first, then perturbations, then benchmarks. The entries stand in the reply as
  // bytes, which are written to the envelope as they are: `reply->catalogue()` is empty until the
  // envelope is parsed.
  void FillPage(const pb::CatalogueRequest& request, pb::Reply* reply);

 private:
  // Takes over what the models folder holds, as far as it has answered.
  void ReadFolder();
  void Serialise();
  void SerialiseBenchmarks();
  // Appends an entry, named `name`, to `entries`.
  void Add(const std::string& name, const pb::CatalogueReply& entry,
           std::vector<std::string>* entries) const;

  FolderLook<std::vector<std::string>> models_folder_;
  const size_t page_bytes_;  // of all entries of a page
  std::vector<std::string> files_;
  // Each entry is a serialised CatalogueReply that holds it alone.
  std::vector<std::string> entries_;
  std::vector<std::string> benchmarks_;
  std::function<std::vector<Benchmark>()> read_benchmarks_;  // empty once they were read
};

}  // namespace b4mrl

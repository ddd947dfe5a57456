// The two ways in which perturbations are named: by their parameters and by presets.
//
// Thread-safe.
#pragma once

#include <string>

#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"

namespace b4mrl {

// Perturbations in parametric form: "hidden-high" of HalfCheetah is "hidden=9".
Result<std::string> Parametric(const std::string& text, const std::string& environment,
                               const pb::CatalogueReply& catalogue);

// The same with the names of the environment's presets, where they say it: "hidden=9" of
// HalfCheetah is "hidden-high".
Result<std::string> ByPresets(const std::string& text, const std::string& environment,
                              const pb::CatalogueReply& catalogue);

// kUnknownName where a name is neither a perturbation's nor a preset's of any environment.
Status CheckPerturbations(const std::string& text, const pb::CatalogueReply& catalogue);

}  // namespace b4mrl

// The SVG files of `b4mrl dataset info --svg`: a dataset is read from the daemon in parts, twice.
#pragma once

#include <string>
#include <vector>

#include "client/client.h"
#include "proto/base/status.h"

namespace b4mrl {

// Writes returns.svg, observations.svg and actions.svg into `folder`, which is made if missing;
// dimensions that do not fit one picture go on in observations-2.svg and so forth. A corrupted
// dataset's observations are drawn beside the clean ones, for which the dataset is opened again.
// Returns the files' paths. Errors: kIoError for the folder and files, otherwise the daemon's.
Result<std::vector<std::string>> WriteDatasetPictures(Client& client, RemoteDataset& dataset,
                                                      const std::string& folder, bool quiet);

}  // namespace b4mrl

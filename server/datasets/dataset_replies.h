// What the requests ListDatasets and OpenDataset ask for, and their replies. Pure functions; any
// thread.
#pragma once

#include <vector>

#include "proto/b4mrl.pb.h"
#include "server/datasets/dataset_store.h"

namespace b4mrl {

// The datasets from number `first` on, as many as fit an envelope.
void FillList(const std::vector<DatasetFileInfo>& list, uint32_t first, pb::ListDatasetsReply* out);

// kInvalidArgument for an unknown transition rule and for too many corruptions.
Result<DatasetRequest> ReadOpen(const pb::OpenDatasetRequest& request);

// Describes an opened dataset; `opened.dataset` is not null.
void FillOpened(const OpenedDataset& opened, pb::OpenDatasetReply* out);

}  // namespace b4mrl

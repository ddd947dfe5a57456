// The replies to ListDatasets and OpenDataset. Texts that come from a file are cut to a length and
// made printable here. Pure functions; any thread.
#pragma once

#include <string>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "server/datasets/dataset_store.h"

namespace b4mrl {

// A file's text about its behaviour policy as replies show it: at most 200 printable characters.
std::string PlainPolicy(const std::string& text);

// The datasets from number `first` on, as many as fit an envelope.
void FillList(const std::vector<DatasetFileInfo>& list, uint32_t first, pb::ListDatasetsReply* out);

// Describes an opened dataset; `opened.dataset` is not null.
void FillOpened(const OpenedDataset& opened, pb::OpenDatasetReply* out);

}  // namespace b4mrl

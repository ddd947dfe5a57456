// The replies to Sample, Read and DatasetStats. Rows are gathered straight into the frame that is
// sent. Pure functions of a dataset and a request; any thread. Errors: kInvalidArgument with the
// argument's name.
#pragma once

#include <functional>

#include "data/columns/dataset.h"
#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"

namespace b4mrl {

// Each fills the reply's payload case and table of arrays, and returns frame 2. Rows that have to
// come from the disk can take long: `alive` is called every few dozen rows.
Result<Frame> AnswerFrom(const Dataset& dataset, const pb::SampleRequest& request,
                         const std::function<void()>& alive, pb::Reply* reply);
Result<Frame> AnswerFrom(const Dataset& dataset, const pb::ReadRequest& request,
                         const std::function<void()>& alive, pb::Reply* reply);
Result<Frame> AnswerFrom(const Dataset& dataset, const pb::DatasetStatsRequest& request,
                         const std::function<void()>& alive, pb::Reply* reply);

}  // namespace b4mrl

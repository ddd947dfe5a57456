// One factory for each kind of request that works on a session. A factory validates all that the
// request says before anything is executed. It returns a job, which can fail only for reasons of
// the simulator, or the typed error to reply with. Socket's thread.
//
// A job without items needs no execution, as all its lanes are answered from their slots; it only
// has to be completed.
#pragma once

#include <memory>

#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"
#include "server/worker/request_job.h"
#include "server/worker/session.h"

namespace b4mrl {

struct HandlerInput {
  Session* session = nullptr;
  const pb::Request* request = nullptr;
  Frame payload;
};

Result<std::unique_ptr<RequestJob>> NewStepJob(HandlerInput input);
Result<std::unique_ptr<RequestJob>> NewResetJob(HandlerInput input);
Result<std::unique_ptr<RequestJob>> NewQueryJob(HandlerInput input);
Result<std::unique_ptr<RequestJob>> NewSnapshotJob(HandlerInput input);
Result<std::unique_ptr<RequestJob>> NewRestoreJob(HandlerInput input);
Result<std::unique_ptr<RequestJob>> NewRenderJob(HandlerInput input);

}  // namespace b4mrl

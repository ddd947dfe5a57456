// One factory for each kind of request that works on a session. Socket's thread.
#pragma once

#include <memory>

#include "server/worker/request_job.h"

namespace b4mrl {

std::unique_ptr<RequestJob> NewStepJob(JobInput input);
std::unique_ptr<RequestJob> NewResetJob(JobInput input);
std::unique_ptr<RequestJob> NewQueryJob(JobInput input);
std::unique_ptr<RequestJob> NewSnapshotJob(JobInput input);
std::unique_ptr<RequestJob> NewRestoreJob(JobInput input);
std::unique_ptr<RequestJob> NewRenderJob(JobInput input);

}  // namespace b4mrl

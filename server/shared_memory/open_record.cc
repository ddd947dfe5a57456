#include "server/shared_memory/open_record.h"

#include <string>

namespace b4mrl {

Result<pb::OpenRequest> OpenRequestOf(const SessionRecord& record) {
  B4MRL_RETURN_IF_ERROR(CheckSessionRecord(record));
  pb::OpenRequest request;
  if (!request.ParseFromString(std::string(SessionOpenBytes(record)))) {
    return Status(StatusCode::kDataLoss, "the session's record holds no Open");
  }
  return request;
}

}  // namespace b4mrl

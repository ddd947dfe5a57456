#include "server/replies/pending_request.h"

#include <functional>
#include <string>

namespace b4mrl {
namespace {

size_t ContentsOf(PendingRequest* pending) {
  if (!pending->contents) {
    pb::Request request = pending->request;
    request.clear_deadline_ms();
    pending->contents = std::hash<std::string>()(request.SerializeAsString());
  }
  return *pending->contents;
}

}  // namespace

bool IsCopy(PendingRequest* one, PendingRequest* other) {
  return one->from.request_id == other->from.request_id && one->from.peer == other->from.peer &&
         ContentsOf(one) == ContentsOf(other);
}

}  // namespace b4mrl

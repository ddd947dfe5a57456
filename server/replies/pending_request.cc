#include "server/replies/pending_request.h"

#include <functional>
#include <string>

namespace b4mrl {
namespace {

size_t ContentsOf(PendingRequest* pending) {
  if (!pending->contents) pending->contents = HashOfContents(&pending->request);
  return *pending->contents;
}

}  // namespace

size_t HashOfContents(pb::Request* request) {
  const uint32_t deadline_ms = request->deadline_ms();
  request->clear_deadline_ms();
  const size_t hash = std::hash<std::string>()(request->SerializeAsString());
  request->set_deadline_ms(deadline_ms);
  return hash;
}

Status OtherContents(uint64_t request_id) {
  return InvalidArgument("request_id", std::to_string(request_id),
                         "an id that is not under way with other contents");
}

bool IsCopy(PendingRequest* one, PendingRequest* other) {
  return one->from.request_id == other->from.request_id && one->from.peer == other->from.peer &&
         ContentsOf(one) == ContentsOf(other);
}

}  // namespace b4mrl

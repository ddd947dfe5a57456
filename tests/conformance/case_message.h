// One message of a conformance case: requests as the table writes them, and replies as the table
// judges them. Pure functions; any thread.
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"

namespace b4mrl::conformance {

// The bytes of one array of a reply.
struct ArrayBytes {
  int dtype = 0;
  std::vector<uint64_t> shape;
  std::string bytes;
  bool operator==(const ArrayBytes&) const = default;
};

struct ReplyMessage {
  pb::Reply envelope;
  std::map<std::string, ArrayBytes> arrays;
  Status unreadable;  // not OK: the envelope or an array is malformed
};

using Labels = std::map<std::string, ReplyMessage>;

// Both frames of a step's `request` and `arrays`. Mistakes in the table are kInvalidArgument.
Result<Message> BuildRequest(const nlohmann::json& step, const std::string& token, uint64_t id,
                             const Labels& labels);
// The frames of a step's `raw`.
Result<std::vector<std::string>> BuildRaw(const nlohmann::json& step);
std::string FromHex(const std::string& text);

ReplyMessage ReadReply(Message message);
// What is true of every reply, and what `step` expects of this one.
Status CheckReply(const nlohmann::json& step, const ReplyMessage& reply, uint64_t id,
                  const Labels& labels);

}  // namespace b4mrl::conformance

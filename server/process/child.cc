#include "server/process/child.h"

#include <utility>

namespace b4mrl {
namespace {

uint32_t ChildIndex(const ChildOptions& options) {
  if (options.role == "gateway") return kGatewayChild;
  if (options.role == "dataset-worker") return kDatasetChild;
  return kFirstWorkerChild + options.index;
}

}  // namespace

ChildContext::ChildContext(ChildOptions options, SharedState shared)
    : options_(std::move(options)),
      shared_(std::move(shared)),
      child_index_(ChildIndex(options_)) {}

}  // namespace b4mrl

#include "proto/wire/named_arguments.h"

namespace b4mrl {

void AddNamedArguments(const std::vector<NamedArgument>& items, NamedArgumentMessages* out) {
  for (const NamedArgument& item : items) {
    pb::NamedArgument* message = out->Add();
    message->set_name(item.name);
    message->set_argument(item.argument);
  }
}

std::vector<NamedArgument> NamedArgumentsOf(const NamedArgumentMessages& messages) {
  std::vector<NamedArgument> items;
  for (const pb::NamedArgument& message : messages) {
    items.push_back({message.name(), message.argument()});
  }
  return items;
}

}  // namespace b4mrl

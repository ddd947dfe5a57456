#include "proto/wire/named_arguments.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("Perturbations come back from their messages as they were, in their order") {
  const std::vector<NamedArgument> items = {{"gravity", "1.5"}, {"obs-noise-low", ""}};
  pb::OpenRequest open;
  open.add_perturbations()->set_name("friction");
  AddNamedArguments(items, open.mutable_perturbations());
  const std::vector<NamedArgument> read = NamedArgumentsOf(open.perturbations());
  CHECK(read == std::vector<NamedArgument>{{"friction", ""}, items[0], items[1]});
}

}  // namespace
}  // namespace b4mrl

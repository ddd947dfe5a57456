#define CATCH_CONFIG_MAIN
#include <catch2/catch.hpp>

#include "proto/base/version.h"

// Tests are not linked again at every commit.
std::string_view b4mrl::BuildCommit() { return "0123456789ab"; }

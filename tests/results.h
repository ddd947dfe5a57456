// A Status or Result that must be OK. For tests.
#pragma once

#include <catch2/catch.hpp>
#include <utility>

#include "proto/base/status.h"

namespace b4mrl {

// REQUIREs an OK status and shows its text otherwise.
inline void RequireOk(const Status& status) {
  INFO(status.ToString());
  REQUIRE(status.ok());
}

// The value of a result that must have one.
template <typename T>
T Take(Result<T> result) {
  RequireOk(result.status());
  return std::move(result).value();
}

}  // namespace b4mrl

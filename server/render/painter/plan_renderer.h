// Draws a PlanView into pixels with Cairo. A picture of 600 x 150 takes about a millisecond. Any
// thread, one at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "proto/base/status.h"
#include "server/environments/canvas.h"

namespace b4mrl {

// `picture` has 3 * width * height bytes. kUnavailable where memory is refused.
Status DrawPlanWithCairo(const PlanView& plan, uint32_t width, uint32_t height,
                         std::span<std::byte> picture);

}  // namespace b4mrl

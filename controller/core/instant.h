// Time as the core sees it: nanoseconds of a monotonic clock whose start means nothing.
//
// Nobody under core/ or devices/ reads a clock; every event brings its Instant. In a virtual rig
// the clock is the rig's, so deadlines keep their meaning at any speed.
#pragma once

#include <chrono>

namespace reforge {

using Instant = std::chrono::nanoseconds;
using Duration = std::chrono::nanoseconds;

constexpr Instant kNever = Instant::max();

constexpr Instant earlier(Instant a, Instant b) {
  return a < b ? a : b;
}

}  // namespace reforge

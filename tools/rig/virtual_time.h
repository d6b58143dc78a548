// Virtual time: nanoseconds since the virtual rig was powered on, as int64_t named `..._ns`.
#pragma once

#include <cstdint>
#include <limits>

namespace reforge {

constexpr int64_t kNsPerMs = 1'000'000;
constexpr int64_t kNsPerSecond = 1'000 * kNsPerMs;
constexpr int64_t kNeverNs = std::numeric_limits<int64_t>::max();

}  // namespace reforge

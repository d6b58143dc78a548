// From planes that serve every base to planes that leave everything reachable (paper.md 4.2).
//
// All planes move together towards the base, 30 % of what is left of the way at a time, until the
//   clipping is feasible; then the last step is bisected, so that it does not overshoot. A clipping
//   that is feasible already is returned as it is. If no step helps, everything above a height is
//   taken, as little as helps.
#pragma once

#include <optional>

#include "planner/reuse/clipping.h"

namespace reforge {

// `start` must be combined and counted. Nothing: no position of the planes is feasible.
std::optional<Clipping> feasible_offset(const ClippingModel& model, const Clipping& start);

}  // namespace reforge

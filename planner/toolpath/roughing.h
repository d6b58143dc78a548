// Roughing: takes what is to go from one direction, level by level, and leaves an allowance on V_R.
//
// Purpose: z-levels from the top of the rest down, a stepdown apart; on each level the tip's
// allowed region (tool-offset surface of V_R + allowance, fixture, base, holder against the stock
// of that moment), cut contour-parallel where rest remains. Units: mm, the block's frame.
// Invariants: the cutter never enters material by a straight plunge (ramps along the first
// contour); loops run so that the rest lies on the right (climb, spindle clockwise); the holder
// clears the stock of the level's start; what is reached is cut out of `stock`. Limits: the
// engagement angle is not limited (the first contour of a closed pocket is a full slot); pieces
// shorter than 0.3 mm in material are left to finishing.
#pragma once

#include <functional>

#include "planner/toolpath/milling.h"

namespace reforge {

// `interrupted` is asked between levels.
std::vector<Path> rough(const MillingOptions& options, const Surroundings& solids,
                        const std::function<bool()>& interrupted, BlockStock& stock);

}  // namespace reforge

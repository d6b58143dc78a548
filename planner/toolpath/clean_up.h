// Clean-up: takes what roughing could not enter, in lines that follow V_R's own tool-offset
// surface.
//
// Purpose: the rest in pockets that the ball only just fits. Roughing leaves it there because its
// allowance closes the pocket, or because the pocket's region on a level falls between the nodes of
// its grid or is too small to ramp in. Units: mm, the block's frame. Method: levels a stepdown
// apart, as in roughing; on each, lines along u and then along v, 0.3 mm apart, on the higher of
// the level and the lowest place that V_R, fixture, base and holder allow; only where the ball
// still stands in rest. Invariants: tips lie 0.01 mm above the tool-offset surface, their chords
// 0.005 mm off it at most; entries ramp along the line; what is reached is cut out of `stock`.
// Limits: slots that leave the ball less than 0.3 mm of play may be missed; where the ball would
// stand deeper than its radius in stock nothing is cut; lines end where they would rise more
// steeply than 5 : 1.
#pragma once

#include <functional>
#include <vector>

#include "planner/toolpath/milling.h"

namespace reforge {

// Paths are appended, linked to those before. `interrupted` is asked between levels.
void clean_up(const MillingOptions& options, const Surroundings& solids,
              const std::function<bool()>& interrupted, BlockStock& stock,
              std::vector<Path>& paths);

}  // namespace reforge

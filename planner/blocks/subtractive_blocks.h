// From which directions V_S is milled, and in what order.
//
// Purpose: the base directions (+z, ±x, ±y) as far as each helps, then further directions by what
// they add, until what is left cannot be reached or is not worth a turn of the table. Source:
// paper, section 6 ("roughing along the four directions ... for the remaining volumes additional
// directions"). Units: mm, part frame. Method: for a direction, the lowest surface that ball and
// holder can sweep over V_R, fixture and base, on a height map; what lies above it can be removed.
// The fewest that serve every group of voxels or surface worth a turn of the table (set cover,
// GLPK), in the order of what they take; then greedily for what many small groups amount to.
// Limits: the holder is tested against V_R and fixture, not against stock that other
// blocks remove; map pitch 0.6 mm.
#pragma once

#include <functional>
#include <vector>

#include "planner/toolpath/machined_surface.h"
#include "planner/toolpath/milling.h"

namespace reforge {

// `further` are directions known to help (ReusePlan::cutter_directions); `reachable` rejects those
// that the machine cannot turn to.
std::vector<Vec3> milling_directions(const MillingOptions& options, const Surroundings& solids,
                                     const PartStock& stock,
                                     const std::vector<MachinedSample>& surface,
                                     const std::vector<Vec3>& further,
                                     const std::function<bool(const Vec3&)>& reachable);

// What of the rest still present could be taken from a direction if V_R and fixture alone stood;
// the skin next to V_R is left out.
BitSet removable_along(const MillingOptions& options, const Surroundings& solids,
                       const PartStock& stock, const Vec3& direction);

}  // namespace reforge

// The two tools as the planner's collision rules see them.
//
// Every body is taken as upward closed (DESIGN.md, idea 2; height_map.h, tip_heights): what lies
// above a wide section counts as just as wide, so a head's finite upper end gives no reach. Units:
// mm, from the tip up. Source: RIG.md, "Tools of the paper"; rig file otherwise.
#pragma once

#include <vector>

#include "protocols/rig.h"

namespace reforge {

struct Cutter {
  double ball_radius_mm;
  double flute_length_mm;
  std::vector<ToolSection> holder;  // only what is wider than the ball
};

struct Nozzle {
  std::vector<ToolSection> body;
};

// The tools that count in a mode: the paper's, or the rig's.
Cutter cutter_of(const RigDescription& rig, Mode mode);
Nozzle nozzle_of(const RigDescription& rig, Mode mode);

}  // namespace reforge

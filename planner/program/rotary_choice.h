// Which rotary angles a block is worked at: the least travel among those where everything fits.
//
// Purpose: of the two solutions (and C's laps) the first in order of rotary travel whose linear
// moves stay within the axes' travels and, in strict mode, whose idle tool clears what stands.
// Units: mm, radians.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/machine/kinematics.h"
#include "planner/toolpath/toolpath.h"
#include "protocols/rig.h"

namespace reforge {

struct RotaryChoice {
  RotaryAngles angles;
  std::string objection;  // why not even this one fits; empty: it does
};

// Programmed point minus active tip: zero for the cutter, minus the deployed offset for the nozzle.
Vec3 programmed_shift(const RigDescription& rig, BlockKind kind);

// nullopt: no angles within the rotary travels.
std::optional<RotaryChoice> choose_angles(const RigDescription& rig, Mode mode,
                                          const std::vector<const TriangleMesh*>& solids,
                                          const BlockToolpath& block, double safe_z,
                                          const RotaryAngles& previous);

}  // namespace reforge

// What holds the part in strict mode: a pedestal under its foot, on the rotary table's disc.
//
// Units: mm, part frame; everything lies below z = 0. The pedestal is the foot of V_R (where it
// stands on
//   z = 0) drawn in by the rig's inset, straight down to the disc; the disc is centred on the C
//   axis.
// Limits: holes in the foot are filled; parts of the foot too narrow to hold are left without
// pedestal.
#pragma once

#include <optional>

#include "planner/geometry/mesh.h"
#include "protocols/rig.h"

namespace reforge {

// Nothing: the foot leaves no pedestal of the rig's minimum width.
std::optional<TriangleMesh> make_fixture(const TriangleMesh& reused, const RigDescription& rig);

}  // namespace reforge

// The five-axis table: where tool tip, rotary axes and part meet.
//
// Purpose: part frame <-> machine frame for a BC or AC rotary table (RIG.md, "Kinematics"), and the
// choice of rotary angles for a tool axis. Units: mm, radians. The tool never tilts: in the machine
// frame its axis is +z. Invariants: to_part(k, a, to_machine(k, a, p)) = p to rounding; tool_axis()
// is a unit vector of the part frame. Linear travels are not judged here (post.h); rotary travels
// are.
#pragma once

#include <vector>

#include "planner/geometry/mesh.h"
#include "protocols/rig.h"

namespace reforge {

// Values of the two rotary axes as programmed.
struct RotaryAngles {
  Radians tilt;  // B or A
  Radians c;
  friend bool operator==(const RotaryAngles&, const RotaryAngles&) = default;
};

// Where the tool tip must be programmed (G54) to touch the part's point, and back.
Point<MachineFrame> to_machine(const Kinematics& kinematics, const RotaryAngles& angles,
                               const Point<PartFrame>& point);
Point<PartFrame> to_part(const Kinematics& kinematics, const RotaryAngles& angles,
                         const Point<MachineFrame>& tip);

// The rotation part of to_machine: maps vectors of the part frame to the machine frame.
Eigen::Matrix3d part_to_machine_rotation(const Kinematics& kinematics, const RotaryAngles& angles);

// The direction the tool points back to its spindle, seen from the part.
Vec3 tool_axis(const Kinematics& kinematics, const RotaryAngles& angles);

// All angles within the rotary travels that give this tool axis, the smallest travel (sum of both
// axes) from `previous` first. Along the C axis C is free and keeps its previous value. Empty:
// unreachable.
std::vector<RotaryAngles> rotary_solutions(const RigDescription& rig, const Vec3& axis,
                                           const RotaryAngles& previous);

// Centre of rotation that both axes' motions keep near: the point on the tilt axis nearest to the C
// axis. A sphere around it that holds the part holds it in every pose once its radius is
// swept_radius().
Point<MachineFrame> tilt_pivot(const Kinematics& kinematics);

// The largest distance from tilt_pivot() that any of the part's points reaches as C turns and the
// table tilts. `part` is in the part frame.
double swept_radius(const Kinematics& kinematics, const std::vector<Vec3>& part);

inline Point<PartFrame> part_point(const Vec3& p) {
  return {p.x(), p.y(), p.z()};
}

}  // namespace reforge

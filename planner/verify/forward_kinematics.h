// From the machine's axes to the part: where the tool tip is, and from where it comes.
//
// The verifier's own formula (RIG.md, "Kinematics"), written apart from the planner's so that a
// shared sign error cannot cancel:
//   BC table  p = r + Rz(s_C c) [ Ry(s_tilt b) (j - r - D) + D ]
//   AC table  p = r + Rz(s_C c) [ Rx(s_tilt a) (j - r - D) + D ]
// j: programmed point (cutter tip, G54, mm); r: a point on the C axis; D: from r to the tilt axis.
// At one rotary position this is rigid: p = turn j + shift.
#pragma once

#include "planner/geometry/mesh.h"
#include "protocols/rig.h"

namespace reforge::verify {

struct Pose {
  Eigen::Matrix3d turn;  // machine -> part
  Vec3 shift;

  Vec3 to_part(const Vec3& machine) const { return turn * machine + shift; }
  Vec3 to_machine(const Vec3& part) const { return turn.transpose() * (part - shift); }
  Vec3 tool_axis() const { return turn.col(2); }  // in the part frame, from the tip to the spindle
};

Pose pose_at(const Kinematics& kinematics, double tilt_rad, double c_rad);

}  // namespace reforge::verify

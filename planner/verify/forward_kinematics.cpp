#include "planner/verify/forward_kinematics.h"

#include <cmath>

namespace reforge::verify {

Pose pose_at(const Kinematics& k, double tilt_rad, double c_rad) {
  const double t = k.sign_tilt * tilt_rad;
  const double g = k.sign_c * c_rad;
  Eigen::Matrix3d tilt;
  if (k.table == RotaryTable::kBC) {
    tilt << std::cos(t), 0, std::sin(t), 0, 1, 0, -std::sin(t), 0, std::cos(t);
  } else {
    tilt << 1, 0, 0, 0, std::cos(t), -std::sin(t), 0, std::sin(t), std::cos(t);
  }
  Eigen::Matrix3d turn;
  turn << std::cos(g), -std::sin(g), 0, std::sin(g), std::cos(g), 0, 0, 0, 1;
  const Vec3 r(k.c_axis_point_mm.x, k.c_axis_point_mm.y, k.c_axis_point_mm.z);
  const Vec3 d(k.tilt_offset_mm.x, k.tilt_offset_mm.y, k.tilt_offset_mm.z);
  Pose pose;
  pose.turn = turn * tilt;
  pose.shift = r + turn * d - pose.turn * (r + d);
  return pose;
}

}  // namespace reforge::verify

#include "planner/machine/kinematics.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

namespace reforge {
namespace {

constexpr double kPi = std::numbers::pi;
// Below this distance from the C axis' direction (a sine), C is taken as free: 1e-9 rad moves a
// point 100 mm away by 1e-7 mm.
constexpr double kAlongC = 1e-9;
// Slack on a rotary limit, rad: a limit stated in degrees must admit the angle it states.
constexpr double kLimitSlack = 1e-9;

Vec3 vec(const Point<MachineFrame>& p) {
  return {p.x, p.y, p.z};
}
Point<MachineFrame> machine_point(const Vec3& p) {
  return {p.x(), p.y(), p.z()};
}

Eigen::Matrix3d about_c(double angle) {
  return Eigen::AngleAxisd(angle, Vec3::UnitZ()).toRotationMatrix();
}
Eigen::Matrix3d about_tilt(RotaryTable table, double angle) {
  const Vec3 axis = table == RotaryTable::kBC ? Vec3::UnitY() : Vec3::UnitX();
  return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
}

bool within(const RotaryAxis& axis, double angle) {
  return angle >= axis.min.value() - kLimitSlack && angle <= axis.max.value() + kLimitSlack;
}

}  // namespace

Eigen::Matrix3d part_to_machine_rotation(const Kinematics& k, const RotaryAngles& angles) {
  return about_tilt(k.table, -k.sign_tilt * angles.tilt.value()) *
         about_c(-k.sign_c * angles.c.value());
}

Point<MachineFrame> to_machine(const Kinematics& k, const RotaryAngles& angles,
                               const Point<PartFrame>& point) {
  // j = r + D + Rt(-s_t tilt) [ Rz(-s_c c) (p - r) - D ]
  const Vec3 r = vec(k.c_axis_point_mm), d = vec(k.tilt_offset_mm);
  const Vec3 p(point.x, point.y, point.z);
  const Vec3 turned = about_c(-k.sign_c * angles.c.value()) * (p - r);
  return machine_point(r + d +
                       about_tilt(k.table, -k.sign_tilt * angles.tilt.value()) * (turned - d));
}

Point<PartFrame> to_part(const Kinematics& k, const RotaryAngles& angles,
                         const Point<MachineFrame>& tip) {
  // p = r + Rz(s_c c) [ Rt(s_t tilt) (j - r - D) + D ]
  const Vec3 r = vec(k.c_axis_point_mm), d = vec(k.tilt_offset_mm);
  const Vec3 upright =
      about_tilt(k.table, k.sign_tilt * angles.tilt.value()) * (vec(tip) - r - d) + d;
  const Vec3 p = r + about_c(k.sign_c * angles.c.value()) * upright;
  return {p.x(), p.y(), p.z()};
}

Vec3 tool_axis(const Kinematics& k, const RotaryAngles& angles) {
  return part_to_machine_rotation(k, angles).transpose() * Vec3::UnitZ();
}

std::vector<RotaryAngles> rotary_solutions(const RigDescription& rig, const Vec3& axis,
                                           const RotaryAngles& previous) {
  assert(std::abs(axis.norm() - 1) < 1e-6);
  const Kinematics& k = rig.kinematics;
  const double sine = std::hypot(axis.x(), axis.y());
  const double tilt = std::atan2(sine, axis.z());
  const bool c_is_free = sine < kAlongC;
  const double turn = k.table == RotaryTable::kBC ? std::atan2(axis.y(), axis.x())
                                                  : std::atan2(axis.x(), -axis.y());
  std::vector<RotaryAngles> solutions;
  for (const bool second : {false, true}) {
    const double t = k.sign_tilt * (second ? -tilt : tilt);
    if (!within(rig.tilt, t)) continue;
    if (c_is_free) {
      if (!second || tilt > kPi / 2) solutions.push_back({Radians::of(t), previous.c});
      continue;
    }
    const double c = k.sign_c * (second ? turn + kPi : turn);
    for (int lap = -3; lap <= 3; ++lap) {
      const double lapped = c + 2 * kPi * lap;
      if (within(rig.c, lapped)) solutions.push_back({Radians::of(t), Radians::of(lapped)});
    }
  }
  const auto travel = [&](const RotaryAngles& s) {
    return std::abs(s.tilt.value() - previous.tilt.value()) +
           std::abs(s.c.value() - previous.c.value());
  };
  std::stable_sort(
      solutions.begin(), solutions.end(),
      [&](const RotaryAngles& a, const RotaryAngles& b) { return travel(a) < travel(b) - 1e-9; });
  return solutions;
}

Point<MachineFrame> tilt_pivot(const Kinematics& k) {
  return machine_point(vec(k.c_axis_point_mm) + vec(k.tilt_offset_mm));
}

double swept_radius(const Kinematics& k, const std::vector<Vec3>& part) {
  // As C turns, a point moves on a circle about the C axis; its distance from the pivot is largest
  // where the circle is farthest from it. Tilting keeps the distance.
  const Vec3 r = vec(k.c_axis_point_mm), d = vec(k.tilt_offset_mm);
  const double off_axis = std::hypot(d.x(), d.y());
  double radius = 0;
  for (const Vec3& p : part) {
    const double around = std::hypot(p.x() - r.x(), p.y() - r.y()) + off_axis;
    radius = std::max(radius, std::hypot(around, p.z() - r.z() - d.z()));
  }
  return radius;
}

}  // namespace reforge

#include "tools/rig/cnc_axes.h"

namespace reforge {

CncAxes cnc_axes(const RigDescription& rig) {
  constexpr double kPullOff_mm = 1;
  const auto degrees = [](double radians) { return Radians::of(radians).in_degrees(); };
  const RotaryAxis& b = rig.tilt;
  const RotaryAxis& c = rig.c;
  const Point<MachineFrame>& g54 = rig.kinematics.g54_in_machine_mm;
  CncAxes axes;
  axes.letters = rig.kinematics.table == RotaryTable::kBC ? "XYZBC" : "XYZAC";
  axes.min = {rig.x.min_mm, rig.y.min_mm, rig.z.min_mm, b.min.in_degrees(), c.min.in_degrees()};
  axes.max = {rig.x.max_mm, rig.y.max_mm, rig.z.max_mm, b.max.in_degrees(), c.max.in_degrees()};
  axes.rate = {rig.x.rapid_mm_per_s, rig.y.rapid_mm_per_s, rig.z.rapid_mm_per_s,
               degrees(b.rapid_rad_per_s), degrees(c.rapid_rad_per_s)};
  axes.acceleration = {rig.x.acceleration_mm_per_s2, rig.y.acceleration_mm_per_s2,
                       rig.z.acceleration_mm_per_s2, degrees(b.acceleration_rad_per_s2),
                       degrees(c.acceleration_rad_per_s2)};
  axes.g54_origin = {g54.x, g54.y, g54.z, 0, 0};
  axes.home = {rig.x.max_mm - kPullOff_mm, rig.y.max_mm - kPullOff_mm, rig.z.max_mm - kPullOff_mm,
               0, 0};
  return axes;
}

}  // namespace reforge

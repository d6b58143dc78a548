#include "planner/verify/bodies.h"

#include <algorithm>
#include <cmath>

namespace reforge::verify {
namespace {

constexpr double kConeStep = 0.25;

void push(std::vector<Disc>& discs, double height, double radius) {
  for (const Disc& below : discs) {
    if (below.height <= height && below.radius >= radius) return;
  }
  discs.push_back({height, radius});
}

Vec3 vec(const Point<MachineFrame>& p) {
  return {p.x, p.y, p.z};
}

}  // namespace

std::vector<Disc> under_sides(const std::vector<ToolSection>& sections, double from) {
  std::vector<Disc> discs;
  for (const ToolSection& s : sections) {
    if (s.z_to_mm <= from) continue;
    const bool cone = std::isfinite(s.z_to_mm) && s.r_to_mm > s.r_from_mm;
    const int steps = cone ? static_cast<int>(std::ceil((s.r_to_mm - s.r_from_mm) / kConeStep)) : 1;
    for (int k = 0; k < steps; ++k) {
      const double share = static_cast<double>(k) / steps;
      const double z0 = cone ? s.z_from_mm + share * (s.z_to_mm - s.z_from_mm) : s.z_from_mm;
      const double z1 = cone ? z0 + (s.z_to_mm - s.z_from_mm) / steps : s.z_to_mm;
      if (z1 <= from) continue;
      const double radius =
          cone ? s.r_from_mm + (share + 1.0 / steps) * (s.r_to_mm - s.r_from_mm) : s.r_from_mm;
      push(discs, std::max(z0, from), radius);
    }
  }
  return discs;
}

ToolBodies tool_bodies(const CutterDescription& cutter, const NozzleDescription& nozzle) {
  return {0.5 * cutter.diameter_mm,
          {"holder", Vec3::Zero(), under_sides(cutter.holder, cutter.flute_length_mm)},
          {"parked nozzle", vec(nozzle.parked_offset_mm), under_sides(nozzle.body, 0)},
          {"nozzle", vec(nozzle.deployed_offset_mm), under_sides(nozzle.body, 0)},
          0.5 * nozzle.outlet_diameter_mm};
}

}  // namespace reforge::verify

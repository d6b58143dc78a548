// A clipping plane: { x : normal . x = offset }, unit normal pointing to the *far side*, the side that
// is taken away (milled, then printed again). The fabrication base lies on the near side.
#pragma once

#include "planner/geometry/mesh.h"

namespace reforge {

struct Plane {
  Vec3 normal = Vec3::UnitZ();
  double offset = 0;  // mm

  static Plane through(const Vec3& point, const Vec3& unit_normal) {
    return {unit_normal, unit_normal.dot(point)};
  }
  double signed_distance(const Vec3& point) const { return normal.dot(point) - offset; }
};

}  // namespace reforge

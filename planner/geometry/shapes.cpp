#include "planner/geometry/shapes.h"

#include <cassert>
#include <cmath>
#include <numbers>

namespace reforge {

TriangleMesh make_box(const Vec3& lowest, const Vec3& highest) {
  assert((highest - lowest).minCoeff() > 0);
  TriangleMesh box;
  for (int corner = 0; corner < 8; ++corner) {
    box.vertices.emplace_back(corner & 1 ? highest.x() : lowest.x(),
                              corner & 2 ? highest.y() : lowest.y(),
                              corner & 4 ? highest.z() : lowest.z());
  }
  box.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                   {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return box;
}

TriangleMesh make_cylinder(const Vec3& from, const Vec3& to, double radius, int sides) {
  assert(sides >= 3 && radius > 0);
  const Vec3 axis = (to - from).normalized();
  const Vec3 u = axis.unitOrthogonal();
  const Vec3 v = axis.cross(u);
  TriangleMesh cylinder;
  for (const Vec3& centre : {from, to}) {
    for (int i = 0; i < sides; ++i) {
      const double angle = 2 * std::numbers::pi * i / sides;
      cylinder.vertices.push_back(centre + radius * (std::cos(angle) * u + std::sin(angle) * v));
    }
  }
  const auto n = static_cast<std::uint32_t>(sides);
  const std::uint32_t bottom = 2 * n, top = 2 * n + 1;
  cylinder.vertices.push_back(from);
  cylinder.vertices.push_back(to);
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t j = (i + 1) % n;
    cylinder.triangles.push_back({i, j, n + j});
    cylinder.triangles.push_back({i, n + j, n + i});
    cylinder.triangles.push_back({bottom, j, i});
    cylinder.triangles.push_back({top, n + i, n + j});
  }
  return cylinder;
}

}  // namespace reforge

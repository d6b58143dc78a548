#include "planner/verify/view.h"

#include <cassert>
#include <cmath>

namespace reforge::verify {

Vec3 clean_direction(const Vec3& direction) {
  Vec3 d = direction.normalized();
  for (int k = 0; k < 3; ++k) {
    if (std::fabs(d[k]) < 1e-9) d[k] = 0;
  }
  return d.normalized();
}

View make_view(const Vec3& direction, std::span<const Vec3> points, double margin, double pitch) {
  assert(!points.empty() && pitch > 0 && margin >= 0);
  const Vec3 w = clean_direction(direction);
  const Vec3 helper = std::fabs(w.z()) > 0.9 ? Vec3::UnitY() : Vec3::UnitZ();
  const Vec3 u = helper.cross(w).normalized();
  View view;
  view.rotation.row(0) = u;
  view.rotation.row(1) = w.cross(u);
  view.rotation.row(2) = w;
  view.pitch = pitch;
  double u_min = INFINITY, u_max = -INFINITY, v_min = INFINITY, v_max = -INFINITY;
  for (const Vec3& p : points) {
    const Vec3 q = view.to_view(p);
    u_min = std::min(u_min, q.x());
    u_max = std::max(u_max, q.x());
    v_min = std::min(v_min, q.y());
    v_max = std::max(v_max, q.y());
  }
  view.u0 = std::floor((u_min - margin) / pitch) * pitch;
  view.v0 = std::floor((v_min - margin) / pitch) * pitch;
  view.nu = static_cast<int>(std::ceil((u_max + margin - view.u0) / pitch));
  view.nv = static_cast<int>(std::ceil((v_max + margin - view.v0) / pitch));
  return view;
}

}  // namespace reforge::verify

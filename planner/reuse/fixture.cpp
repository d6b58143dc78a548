#include "planner/reuse/fixture.h"

#include <algorithm>
#include <cmath>
#include <polyclipping/clipper.hpp>

#include "planner/geometry/mesh_topology.h"
#include "planner/geometry/shapes.h"

namespace reforge {
namespace {

using ClipperLib::IntPoint;
using ClipperLib::Path;
using ClipperLib::Paths;

constexpr double kScale = 1e4;    // Clipper counts in 0.1 micrometres
constexpr double kOnBase = 1e-3;  // mm

Paths foot_of(const TriangleMesh& solid) {
  ClipperLib::Clipper clipper;
  for (const auto& triangle : solid.triangles) {
    Path path;
    double highest = -1;
    for (const auto vertex : triangle) {
      const Vec3& p = solid.vertices[vertex];
      highest = std::max(highest, p.z());
      path.emplace_back(std::llround(p.x() * kScale), std::llround(p.y() * kScale));
    }
    if (highest > kOnBase || ClipperLib::Area(path) == 0) continue;
    if (!ClipperLib::Orientation(path)) ClipperLib::ReversePath(path);
    clipper.AddPath(path, ClipperLib::ptSubject, true);
  }
  Paths foot;
  clipper.Execute(ClipperLib::ctUnion, foot, ClipperLib::pftNonZero, ClipperLib::pftNonZero);
  return foot;
}

Paths drawn_in(const Paths& paths, double by) {
  ClipperLib::ClipperOffset offset(2, 0.01 * kScale);
  offset.AddPaths(paths, ClipperLib::jtRound, ClipperLib::etClosedPolygon);
  Paths result;
  offset.Execute(result, -by * kScale);
  return result;
}

double cross(const IntPoint& o, const IntPoint& a, const IntPoint& b) {
  return static_cast<double>(a.X - o.X) * static_cast<double>(b.Y - o.Y) -
         static_cast<double>(a.Y - o.Y) * static_cast<double>(b.X - o.X);
}

bool is_ear(const Path& path, const std::vector<std::uint32_t>& ring, std::size_t i) {
  const std::size_t n = ring.size();
  const IntPoint &a = path[ring[(i + n - 1) % n]], &b = path[ring[i]], &c = path[ring[(i + 1) % n]];
  if (cross(a, b, c) <= 0) return false;
  for (std::size_t k = 2; k + 1 < n; ++k) {
    const IntPoint& p = path[ring[(i + k) % n]];
    if (cross(a, b, p) >= 0 && cross(b, c, p) >= 0 && cross(c, a, p) >= 0) return false;
  }
  return true;
}

// A counter-clockwise simple polygon as triangles, by cutting ears.
std::vector<std::array<std::uint32_t, 3>> triangulated(const Path& path) {
  std::vector<std::uint32_t> ring(path.size());
  for (std::uint32_t i = 0; i < ring.size(); ++i) ring[i] = i;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  while (ring.size() > 3) {
    std::size_t ear = 0;
    while (ear < ring.size() && !is_ear(path, ring, ear)) ++ear;
    if (ear == ring.size()) ear = 0;  // only straight or touching corners are left
    const std::size_t n = ring.size();
    triangles.push_back({ring[(ear + n - 1) % n], ring[ear], ring[(ear + 1) % n]});
    ring.erase(ring.begin() + static_cast<std::ptrdiff_t>(ear));
  }
  if (ring.size() == 3) triangles.push_back({ring[0], ring[1], ring[2]});
  return triangles;
}

TriangleMesh prism(const Path& path, double z_low, double z_high) {
  TriangleMesh mesh;
  const auto n = static_cast<std::uint32_t>(path.size());
  for (const double z : {z_low, z_high}) {
    for (const IntPoint& p : path) {
      mesh.vertices.emplace_back(static_cast<double>(p.X) / kScale,
                                 static_cast<double>(p.Y) / kScale, z);
    }
  }
  for (const auto& [a, b, c] : triangulated(path)) {
    mesh.triangles.push_back({a, c, b});
    mesh.triangles.push_back({a + n, b + n, c + n});
  }
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t next = (i + 1) % n;
    mesh.triangles.push_back({i, next, next + n});
    mesh.triangles.push_back({i, next + n, i + n});
  }
  return mesh;
}

}  // namespace

std::optional<TriangleMesh> make_fixture(const TriangleMesh& reused, const RigDescription& rig) {
  const Paths pedestal = drawn_in(foot_of(reused), rig.pedestal.inset_mm);
  const double top_of_disc = -rig.pedestal.height_mm;
  TriangleMesh fixture;
  for (Path path : pedestal) {
    if (!ClipperLib::Orientation(path)) continue;  // a hole
    if (drawn_in({path}, rig.pedestal.minimum_width_mm / 2).empty()) continue;
    ClipperLib::CleanPolygon(path, 0.005 * kScale);
    if (path.size() >= 3) fixture = joined(fixture, prism(path, top_of_disc, 0));
  }
  if (fixture.empty()) return std::nullopt;
  const double x = rig.kinematics.c_axis_point_mm.x, y = rig.kinematics.c_axis_point_mm.y;
  return joined(fixture, make_cylinder(Vec3(x, y, top_of_disc - rig.table.disc_thickness_mm),
                                       Vec3(x, y, top_of_disc), rig.table.disc_radius_mm, 64));
}

}  // namespace reforge

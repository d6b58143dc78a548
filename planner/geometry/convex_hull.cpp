#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"  // CGAL's empty function objects, g++ 12
#endif

#include "planner/geometry/convex_hull.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/convex_hull_3.h>

#include <algorithm>
#include <cmath>

namespace reforge {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Surface = CGAL::Surface_mesh<Kernel::Point_3>;

constexpr double kOneSide = 0.99985;  // cosine of one degree

bool is_flat(const std::vector<Kernel::Point_3>& points) {
  std::size_t b = 1, c = 1;
  while (b < points.size() && points[b] == points[0]) ++b;
  if (b >= points.size()) return true;
  for (c = b + 1; c < points.size() && CGAL::collinear(points[0], points[b], points[c]);) ++c;
  if (c >= points.size()) return true;
  return std::all_of(points.begin(), points.end(), [&](const Kernel::Point_3& p) {
    return CGAL::coplanar(points[0], points[b], points[c], p);
  });
}

// Whether the ray from the origin along `direction` passes through the triangle.
bool is_over(const Vec3& direction, const Vec3& a, const Vec3& b, const Vec3& c) {
  return direction.dot(a.cross(b)) >= 0 && direction.dot(b.cross(c)) >= 0 &&
         direction.dot(c.cross(a)) >= 0;
}

}  // namespace

TriangleMesh convex_hull(std::span<const Vec3> points) {
  std::vector<Kernel::Point_3> given;
  given.reserve(points.size());
  for (const Vec3& p : points) given.emplace_back(p.x(), p.y(), p.z());
  TriangleMesh hull;
  if (given.size() < 4 || is_flat(given)) return hull;
  Surface surface;
  CGAL::convex_hull_3(given.begin(), given.end(), surface);
  for (const auto v : surface.vertices()) {
    const auto& p = surface.point(v);
    hull.vertices.emplace_back(p.x(), p.y(), p.z());
  }
  for (const auto f : surface.faces()) {
    std::array<std::uint32_t, 3> triangle{};
    std::size_t k = 0;
    for (const auto v : CGAL::vertices_around_face(surface.halfedge(f), surface)) {
      triangle[k++] = static_cast<std::uint32_t>(v);
    }
    hull.triangles.push_back(triangle);
  }
  return hull;
}

std::vector<RestingSide> resting_sides(const TriangleMesh& hull, const Vec3& centre,
                                       double least_share) {
  struct Facet {
    Vec3 normal;
    double area;
    bool taken = false;
  };
  std::vector<Facet> facets;
  double all = 0;
  for (const auto& [a, b, c] : hull.triangles) {
    const auto& v = hull.vertices;
    const Vec3 cross = (v[b] - v[a]).cross(v[c] - v[a]);
    facets.push_back(
        {cross.norm() > 0 ? Vec3(cross.normalized()) : Vec3(Vec3::Zero()), cross.norm() / 2});
    all += cross.norm() / 2;
  }
  std::vector<std::size_t> widest(facets.size());
  for (std::size_t f = 0; f < facets.size(); ++f) widest[f] = f;
  std::stable_sort(widest.begin(), widest.end(),
                   [&](std::size_t a, std::size_t b) { return facets[a].area > facets[b].area; });
  std::vector<RestingSide> sides;
  for (const auto seed : widest) {
    if (facets[seed].taken) continue;
    std::vector<std::size_t> members;
    Vec3 sum = Vec3::Zero();
    double area = 0;
    for (std::size_t f = 0; f < facets.size(); ++f) {
      if (facets[f].taken || facets[f].normal.dot(facets[seed].normal) < kOneSide) continue;
      facets[f].taken = true;
      members.push_back(f);
      sum += facets[f].area * facets[f].normal;
      area += facets[f].area;
    }
    if (area < least_share * all || !(sum.norm() > 0)) continue;
    const Vec3 down = sum.normalized();
    const bool stable = std::any_of(members.begin(), members.end(), [&](std::size_t f) {
      const auto& [a, b, c] = hull.triangles[f];
      return is_over(down, hull.vertices[a] - centre, hull.vertices[b] - centre,
                     hull.vertices[c] - centre);
    });
    if (stable) sides.push_back({down, area});
  }
  std::stable_sort(sides.begin(), sides.end(), [](const RestingSide& a, const RestingSide& b) {
    return a.area_mm2 > b.area_mm2;
  });
  return sides;
}

Vec3 centre_of_gravity(const TriangleMesh& solid) {
  Vec3 sum = Vec3::Zero();
  double six_volumes = 0;
  for (const auto& [a, b, c] : solid.triangles) {
    const Vec3 &p = solid.vertices[a], &q = solid.vertices[b], &r = solid.vertices[c];
    const double six = p.dot(q.cross(r));
    six_volumes += six;
    sum += six * (p + q + r);
  }
  return six_volumes == 0 ? bounds(solid).center() : Vec3(sum / (4 * six_volumes));
}

}  // namespace reforge

#include "planner/reuse/printing_base.h"

#include <algorithm>
#include <map>
#include <numeric>

#include "planner/geometry/mesh_topology.h"
#include "planner/reuse/volumes.h"

namespace reforge {
namespace {

constexpr double kConvexTolerance = 0.02;  // mm a neighbour may rise above a facet's plane

bool is_base(const CellFacet& facet) {
  if (facet.front != kReused && facet.back != kReused) return false;
  const auto other = facet.front == kReused ? facet.back : facet.front;
  return other == kAdded || other == kThenAdded;
}

struct Triangle {
  std::array<Vec3, 3> corner;
  Vec3 normal;  // unit, out of V_R; zero for slivers without a direction
  double area;
};

// A planar facet being grown.
struct Patch {
  Plane plane;
  double area = 0;
  std::vector<std::size_t> triangles;
};

std::vector<std::vector<std::size_t>> neighbours(const TriangleMesh& surface) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::vector<std::size_t>> at_edge;
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const auto a = surface.triangles[t][k], b = surface.triangles[t][(k + 1) % 3];
      at_edge[{std::min(a, b), std::max(a, b)}].push_back(t);
    }
  }
  std::vector<std::vector<std::size_t>> result(surface.triangles.size());
  for (const auto& [edge, members] : at_edge) {
    for (const auto t : members) {
      for (const auto other : members) {
        if (other != t) result[t].push_back(other);
      }
    }
  }
  return result;
}

bool lies_in(const Triangle& triangle, const Plane& plane) {
  for (const Vec3& corner : triangle.corner) {
    if (std::abs(plane.signed_distance(corner)) > kFlat) return false;
  }
  // A sliver has no direction worth asking for.
  return triangle.area < 1e-4 || triangle.normal.dot(plane.normal) > kSameNormal;
}

std::vector<Patch> planar_patches(const std::vector<Triangle>& triangles,
                                  const std::vector<std::vector<std::size_t>>& adjacent) {
  std::vector<std::size_t> order(triangles.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return triangles[a].area > triangles[b].area;
  });
  std::vector<bool> taken(triangles.size(), false);
  std::vector<Patch> patches;
  for (const auto seed : order) {
    if (taken[seed]) continue;
    Patch patch;
    patch.plane = Plane::through(triangles[seed].corner[0], triangles[seed].normal);
    std::vector<std::size_t> front{seed};
    taken[seed] = true;
    while (!front.empty()) {
      const auto t = front.back();
      front.pop_back();
      patch.triangles.push_back(t);
      patch.area += triangles[t].area;
      for (const auto next : adjacent[t]) {
        if (taken[next] || !lies_in(triangles[next], patch.plane)) continue;
        taken[next] = true;
        front.push_back(next);
      }
    }
    patches.push_back(std::move(patch));
  }
  std::stable_sort(patches.begin(), patches.end(),
                   [](const Patch& a, const Patch& b) { return a.area > b.area; });
  return patches;
}

// Neighbouring facets must bend away: each lies below the other's plane near their common edge.
bool is_convex(const std::vector<Patch>& patches, std::size_t count,
               const std::vector<Triangle>& triangles,
               const std::vector<std::vector<std::size_t>>& adjacent) {
  std::vector<std::size_t> patch_of(triangles.size(), patches.size());
  for (std::size_t p = 0; p < count; ++p) {
    for (const auto t : patches[p].triangles) patch_of[t] = p;
  }
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    if (patch_of[t] == patches.size()) continue;
    for (const auto next : adjacent[t]) {
      if (patch_of[next] == patches.size() || patch_of[next] == patch_of[t]) continue;
      for (const Vec3& corner : triangles[next].corner) {
        if (patches[patch_of[t]].plane.signed_distance(corner) > kConvexTolerance) return false;
      }
    }
  }
  return true;
}

void judge(BaseComponent& base, const TriangleMesh& surface) {
  std::vector<Triangle> triangles;
  Vec3 weighted = Vec3::Zero();
  for (const auto& [a, b, c] : surface.triangles) {
    const auto& v = surface.vertices;
    const Vec3 cross = (v[b] - v[a]).cross(v[c] - v[a]);
    const double length = cross.norm();
    triangles.push_back(
        {{v[a], v[b], v[c]}, length > 0 ? Vec3(cross / length) : Vec3(Vec3::Zero()), length / 2});
    weighted += cross / 2;
    base.area_mm2 += length / 2;
  }
  base.mean_normal = weighted.norm() > 1e-9 ? weighted.normalized() : Vec3(Vec3::UnitZ());
  const auto adjacent = neighbours(surface);
  const auto patches = planar_patches(triangles, adjacent);
  double covered = 0;
  std::size_t count = 0;
  while (count < patches.size() && covered < (1 - kSliverArea) * base.area_mm2) {
    covered += patches[count++].area;
  }
  for (std::size_t p = 0; p < std::min(count, kMostFacets); ++p)
    base.planes.push_back(patches[p].plane);
  base.plano_convex = count <= kMostFacets && is_convex(patches, count, triangles, adjacent);
}

}  // namespace

std::vector<Vec3> facet_directions(const std::vector<BaseComponent>& bases) {
  constexpr double kLevel = 1e-3;
  std::vector<Vec3> directions;
  for (const BaseComponent& base : bases) {
    if (!base.plano_convex) continue;
    for (const Plane& plane : base.planes) {
      Vec3 direction = plane.normal;
      if (direction.z() < -kLevel) continue;
      direction.z() = std::max(0.0, direction.z());
      directions.push_back(direction.normalized());
    }
  }
  return directions;
}

std::vector<BaseComponent> printing_bases(const CellComplex& complex,
                                          const std::vector<bool>& is_skin) {
  TriangleMesh surface;
  surface.vertices = complex.vertices;
  std::vector<std::uint32_t> facet_of;
  for (std::uint32_t f = 0; f < complex.facets.size(); ++f) {
    const CellFacet& facet = complex.facets[f];
    if (!is_base(facet) || (facet.mark == 0 && is_skin[facet.origin])) continue;
    auto corners = facet.corners;
    if (facet.front == kReused) std::swap(corners[1], corners[2]);
    surface.triangles.push_back(corners);
    facet_of.push_back(f);
  }
  std::uint32_t count = 0;
  const auto piece = pieces(surface, count);
  std::vector<BaseComponent> bases(count);
  std::vector<TriangleMesh> parts(count);
  for (auto& part : parts) part.vertices = surface.vertices;
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    BaseComponent& base = bases[piece[t]];
    const CellFacet& facet = complex.facets[facet_of[t]];
    base.facets.push_back(facet_of[t]);
    if (facet.mark == 0) base.origins.push_back(facet.origin);
    base.from_clipping |= facet.mark != 0;
    parts[piece[t]].triangles.push_back(surface.triangles[t]);
  }
  for (std::uint32_t i = 0; i < count; ++i) {
    parts[i] = welded(parts[i]);
    std::sort(bases[i].origins.begin(), bases[i].origins.end());
    bases[i].origins.erase(std::unique(bases[i].origins.begin(), bases[i].origins.end()),
                           bases[i].origins.end());
    bases[i].points = parts[i].vertices;
    bases[i].lowest_z = bounds(parts[i]).min().z();
    judge(bases[i], parts[i]);
  }
  return bases;
}

}  // namespace reforge

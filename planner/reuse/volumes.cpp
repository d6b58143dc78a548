#include "planner/reuse/volumes.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "planner/geometry/cgal_mesh.h"
#include "planner/geometry/mesh_topology.h"

namespace reforge {
namespace {

constexpr double kThin = 1e-3;         // mm
constexpr double kOnBase = 1e-3;       // mm above z = 0
constexpr double kSmallestFoot = 0.1;  // mm^2

// A connected shell of one region's boundary.
struct Shell {
  TriangleMesh surface;               // outward
  std::vector<std::uint32_t> facets;  // of the complex
};

std::vector<Shell> shells_of(const CellComplex& complex, Region region) {
  std::vector<std::uint32_t> facets;
  const TriangleMesh surface = surface_of(complex, in(region), &facets);
  std::uint32_t count = 0;
  const auto piece = pieces(surface, count);
  std::vector<Shell> shells(count);
  for (auto& shell : shells) shell.surface.vertices = surface.vertices;
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    shells[piece[t]].surface.triangles.push_back(surface.triangles[t]);
    shells[piece[t]].facets.push_back(facets[t]);
  }
  for (auto& shell : shells) shell.surface = welded(shell.surface);
  return shells;
}

void relabel(CellComplex& complex, const std::vector<std::uint32_t>& facets, Region from,
             Region to) {
  for (const auto f : facets) {
    CellFacet& facet = complex.facets[f];
    if (facet.front == from) facet.front = to;
    if (facet.back == from) facet.back = to;
  }
}

// The region with the most area on the other side of a shell.
Region main_neighbour(const CellComplex& complex, const Shell& shell, Region self) {
  std::array<double, 32> shared{};
  for (const auto f : shell.facets) {
    const auto& [corners, front, back, origin, mark] = complex.facets[f];
    const auto& v = complex.vertices;
    const double twice_area =
        (v[corners[1]] - v[corners[0]]).cross(v[corners[2]] - v[corners[0]]).norm();
    shared[front == self ? back : front] += twice_area;
  }
  return static_cast<Region>(std::max_element(shared.begin(), shared.end()) - shared.begin());
}

double drop_slivers(CellComplex& complex, Region region) {
  double dropped = 0;
  for (const Shell& shell : shells_of(complex, region)) {
    const double shell_volume = volume(shell.surface);
    if (shell_volume < 0 || 2 * shell_volume > kThin * area(shell.surface)) continue;
    dropped += shell_volume;
    relabel(complex, shell.facets, region, main_neighbour(complex, shell, region));
  }
  tidy(complex);
  return dropped;
}

// Area of a shell's triangles that lie on the base.
double standing_area(const TriangleMesh& surface) {
  double standing = 0;
  for (const auto& [a, b, c] : surface.triangles) {
    const auto& v = surface.vertices;
    if (std::max({v[a].z(), v[b].z(), v[c].z()}) > kOnBase) continue;
    standing += (v[b] - v[a]).cross(v[c] - v[a]).norm() / 2;
  }
  return standing;
}

bool identical(const TriangleMesh& a, const TriangleMesh& b) {
  return a.triangles == b.triangles && a.vertices == b.vertices;
}

}  // namespace

Result<Volumes> ideal_volumes(const TriangleMesh& initial, const TriangleMesh& target) {
  Volumes volumes;
  if (identical(initial, target)) {
    volumes.complex.vertices = initial.vertices;
    for (std::uint32_t t = 0; t < initial.triangles.size(); ++t) {
      volumes.complex.facets.push_back({initial.triangles[t], kOutside, kReused, t, 0});
    }
    tidy(volumes.complex);
    return volumes;
  }
  auto both = overlay(initial, target);
  if (!both) return both.error();
  volumes.complex = std::move(*both);
  constexpr std::array<std::uint8_t, 4> kRegionOf{kOutside, kRemoved, kAdded, kReused};
  for (CellFacet& facet : volumes.complex.facets) {
    facet.front = kRegionOf[facet.front];
    facet.back = kRegionOf[facet.back];
  }
  volumes.dropped_mm3 += drop_slivers(volumes.complex, kRemoved);
  volumes.dropped_mm3 += drop_slivers(volumes.complex, kAdded);
  volumes.dropped_mm3 += drop_slivers(volumes.complex, kReused);
  return volumes;
}

double set_loose_pieces_free(CellComplex& complex) {
  const auto shells = shells_of(complex, kReused);
  std::vector<bool> loose(shells.size(), false);
  double freed = 0;
  for (std::size_t i = 0; i < shells.size(); ++i) {
    loose[i] = volume(shells[i].surface) > 0 && standing_area(shells[i].surface) < kSmallestFoot;
  }
  for (std::size_t i = 0; i < shells.size(); ++i) {
    const double shell_volume = volume(shells[i].surface);
    bool goes = loose[i];
    if (shell_volume <= 0) {  // a hollow goes with the piece around it
      for (std::size_t j = 0; j < shells.size() && !goes; ++j) {
        goes = loose[j] && contains(shells[j].surface, shells[i].surface.vertices.front());
      }
    }
    if (!goes) continue;
    freed += shell_volume;
    relabel(complex, shells[i].facets, kReused, kThenAdded);
  }
  tidy(complex);
  return freed;
}

double foot_area(const CellComplex& complex) {
  return standing_area(surface_of(complex, in(kReused)));
}

}  // namespace reforge

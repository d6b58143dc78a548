// Closes outlines that lie in a plane: the triangles that fill them.
//
// Purpose: the caps of a plane cut (plane_cut.h). Outlines come from surfaces whose corners were
//   rounded, so they may touch, overlap or cross by a little. Where they do, nothing is filled yet;
//   instead the answer says which corners fall together, where an edge must be divided, and where a
//   new corner is needed. Once the caller has changed its surfaces accordingly, it asks again.
// Units: mm. Symbols: w how often the outlines wind around a place, counter-clockwise seen from
// where
//   the plane's normal points.
// Invariant: when no change is wanted, the triangles' boundary is exactly the outlines (as a
// chain),
//   whatever w is, so that a surface closed by them is closed. A place with w copies of itself is
//   covered w times, turned over when w < 0; `folded_mm2` is the area where w is neither 0 nor 1.
// Source: constrained Delaunay triangulation by CGAL.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "planner/geometry/plane.h"

namespace reforge {

using UndirectedEdge = std::pair<std::uint32_t, std::uint32_t>;  // the lower vertex first

// By edge: how often the filling has the edge from its lower to its higher vertex on its boundary.
using Outline = std::map<UndirectedEdge, int>;

struct CapChanges {
  std::vector<Vec3> created;                      // numbered after the given vertices
  std::map<std::uint32_t, std::uint32_t> merged;  // vertex: the one it falls on
  std::map<UndirectedEdge, std::vector<std::uint32_t>> divided;  // vertices from low to high
  bool empty() const { return created.empty() && merged.empty() && divided.empty(); }
};

struct Caps {
  CapChanges changes;  // if not empty, the rest is
  std::vector<std::array<std::uint32_t, 3>> triangles;
  double folded_mm2 = 0;
};

// Corners nearer than `within_mm` to each other, or to an edge, are put on each other.
Caps fill_outline(const std::vector<Vec3>& vertices, const Outline& outline, const Plane& plane,
                  double within_mm);

}  // namespace reforge

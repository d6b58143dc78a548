// The convex hull of points, and the flat sides a solid can stand on.
//
// Units: mm, in the frame of the points. Source: convex hull by CGAL, exact in its decisions.
#pragma once

#include <span>
#include <vector>

#include "planner/geometry/mesh.h"

namespace reforge {

// Outward; empty when all points lie in one plane. Corners are among the points, bit by bit.
TriangleMesh convex_hull(std::span<const Vec3> points);

// A side of the hull on which a solid rests by its own weight.
struct RestingSide {
  Vec3 down;        // unit, the side's outward normal
  double area_mm2;  // of the hull's facets there
};

// Sides over which the centre of gravity lies, the widest first, and none smaller than
// `least_share` of the hull's whole area. Facets that differ by less than a degree are one side.
std::vector<RestingSide> resting_sides(const TriangleMesh& hull, const Vec3& centre_of_gravity,
                                       double least_share);

// Centre of gravity of a closed mesh of uniform matter.
Vec3 centre_of_gravity(const TriangleMesh& solid);

}  // namespace reforge

// The one converter to CGAL, and what only CGAL does for us: exact booleans and self-intersection.
//
// An *overlay* of two solids A and B is the union of their surfaces cut along each other, every
// facet labelled by what lies on its two sides: inside A or not, inside B or not. Intersection,
// differences and union are read off the same facets, so their volumes balance and they share their
// borders exactly; nothing is computed twice.
//
// Units: mm. Exactness: intersection points are constructed and classified exactly (EPECK), then
// every
//   coordinate is rounded to float, the precision of STL; facets that collapse by it are dropped
//   and facets that fall together cancel, so every volume stays closed. Rounding moves points by up
//   to 4e-6 mm (at 64 mm), so self-intersections of that size are possible.
// Limits: near-coincident surfaces with different triangles yield slivers of rounding size and cost
//   minutes; surfaces that are bit-equal or exactly coplanar are handled. Refuses with
//   kBooleanFailed.
#pragma once

#include <optional>

#include "planner/geometry/cell_complex.h"
#include "planner/geometry/mesh.h"
#include "protocols/result.h"

namespace reforge {

// Both must be solids. Regions: bit 0 inside A, bit 1 inside B; so 1 is A without B, 2 is B without
// A and 3 is both. A facet's `origin` is its number.
Result<CellComplex> overlay(const TriangleMesh& a, const TriangleMesh& b);

Result<TriangleMesh> boolean_intersection(const TriangleMesh& a, const TriangleMesh& b);
Result<TriangleMesh> boolean_difference(const TriangleMesh& a,
                                        const TriangleMesh& b);  // a without b
Result<TriangleMesh> boolean_union(const TriangleMesh& a, const TriangleMesh& b);

// A point near which the surface passes through itself, if anywhere.
std::optional<Vec3> self_intersects(const TriangleMesh& mesh);

}  // namespace reforge

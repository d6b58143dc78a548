// Cutting solids by a plane, with the cut closed by caps.
//
// Units: mm. The far side is the side the plane's normal points to (plane.h).
// Exactness: new vertices are rounded to float; a vertex nearer to the plane than 1e-5 mm (2.4e-7
// of
//   the largest coordinate, if that is more) counts as on it. Both sides of a cut share cap and
//   split facets, so volumes balance exactly.
// Robustness: where rounding lets cap outlines touch or cross, their corners are put on each other
//   (plane_caps.h), in every facet alike, so regions stay closed. If caps still fold, up to five
//   planes each 4e-5 mm lower are tried and the one that folds least is used (and returned).
// Limits: a surface that really passes through itself is cut, but its caps lie on each other.
#pragma once

#include <functional>
#include <utility>

#include "planner/geometry/cell_complex.h"
#include "planner/geometry/plane.h"
#include "protocols/result.h"

namespace reforge {

// A connected part of a region beyond the plane, offered for cutting off.
struct FarPiece {
  TriangleMesh surface;                // closed by its caps
  std::vector<std::uint32_t> origins;  // of the complex's facets it has; caps left out
};

// Cuts off those connected parts of `region` beyond the plane that `take` wants, and labels them
// `becomes`. Their caps have `region` behind, `becomes` in front, and `mark`. Returns the plane
// used.
Result<Plane> cut_off(CellComplex& complex, const Plane& plane, std::uint8_t region,
                      std::uint8_t becomes, std::uint32_t mark,
                      const std::function<bool(const FarPiece&)>& take);

// The two sides of a solid: near first. Either may be empty.
Result<std::pair<TriangleMesh, TriangleMesh>> split_by(const TriangleMesh& solid,
                                                       const Plane& plane);

}  // namespace reforge

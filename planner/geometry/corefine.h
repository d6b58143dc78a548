// Cuts triangulated surfaces along each other: the one exact step under every boolean.
//
// Units: mm. Exactness: new points are constructed exactly (CGAL, EPECK) and rounded to float at
// the
//   end, so a point that two surfaces share has the same coordinates in both. Given vertices stay
//   as they are, bit by bit.
// Limits: the surfaces may be open; but triangles around a vertex form one fan, and a border may
//   touch the other surface but not cross it. Near-coincident surfaces take minutes and give
//   slivers of rounding size: separate them first (planner/reuse/coincidence.h).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "planner/geometry/mesh.h"
#include "protocols/result.h"

namespace reforge {

struct CutSurface {
  TriangleMesh mesh;                   // the given vertices under their numbers, then the new ones
  std::vector<std::uint32_t> origins;  // by triangle: the given triangle it is a part of
  // For each surface it was cut with: the edges (lower vertex first) the two share, in
  // the same order in both.
  std::vector<std::vector<std::array<std::uint32_t, 2>>> seams;
};

// `first` (cut with all of `others`) and then each of `others` (cut with `first`), cut where
// `first` meets the others. The others do not see each other, but along their seams they have the
// same vertices as `first`. Refuses with kBooleanFailed.
Result<std::vector<CutSurface>> corefine(const TriangleMesh& first,
                                         const std::vector<TriangleMesh>& others);

}  // namespace reforge

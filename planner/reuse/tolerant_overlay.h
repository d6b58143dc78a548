// The overlay of two solids (cgal_mesh.h) for parts that may nearly coincide.
//
// Where the target M* lies within the tolerance of the initial part M, facing the same way, M's
// surface stands for both (coincidence.h): what is removed is M without the grown target, what is
// reused the rest of M, what is added is the shrunk target without M. So M's surface is kept as it
// is, the volumes are closed, share their borders and fill M exactly; M* they fill up to the hair
// by which its surface was moved. Far from coincidence nothing is moved, and this is the exact
// overlay.
//
// Units: mm. Regions as overlay(): 1 initial without target, 2 target without initial, 3 both.
// Speed: only triangles that may cross go to exact arithmetic; everything else is copied.
// Limits: coordinates are rounded to float like overlay()'s. If the separated surfaces cannot be
//   cut, the exact overlay is tried, which may take minutes; then it refuses with kBooleanFailed.
#pragma once

#include "planner/geometry/cell_complex.h"
#include "planner/geometry/mesh.h"
#include "protocols/result.h"

namespace reforge {

struct TolerantOverlay {
  CellComplex complex;
  double coincident_area_mm2 = 0;
  double greatest_distance_mm = 0;  // between surfaces taken for one
  double dropped_mm3 = 0;           // V(M*) - V(2) - V(3): the hair; either sign
};

Result<TolerantOverlay> tolerant_overlay(const TriangleMesh& initial, const TriangleMesh& target,
                                         double tolerance_mm);

}  // namespace reforge

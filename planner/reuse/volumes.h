// The volumes of a placed pair as one labelled complex (cell_complex.h).
//
// Symbols: M initial, M* target; V~_R = M and M*, V~_S = M without V~_R, V~_A = M* without V~_R;
// V_T what is
//   removed and then added again. As regions: V_R kReused, V~_S kRemoved, V~_A kAdded, V_T
//   kThenAdded; so V_S = kRemoved + kThenAdded and V_A = kAdded + kThenAdded.
// Units: mm, part frame. Invariants: every region is closed; the volumes balance to rounding, but
// for
//   `dropped_mm3`.
// Tolerance: where M* lies within the machine's tolerance of M, M's surface stands for both
//   (tolerant_overlay.h). Pieces thinner than the tolerance on average are no matter a tool could
//   cut or lay; they go to the volume they mostly border on. What both change is counted as
//   dropped. Thin skins that hang on a thicker piece stay in the volumes, but are marked: what lies
//   behind a skin is taken to be what lies on its other side, so that nobody has to cut or print
//   it.
#pragma once

#include <cstdint>

#include "planner/geometry/cell_complex.h"
#include "protocols/result.h"

namespace reforge {

enum Region : std::uint8_t { kOutside = 0, kReused = 1, kRemoved = 2, kAdded = 3, kThenAdded = 4 };

constexpr unsigned in(Region region) {
  return 1u << region;
}

struct Volumes {
  CellComplex complex;             // every facet's origin is its own number
  double dropped_mm3 = 0;          // V(M*) - V~_R - V~_A; either sign
  double dropped_initial_mm3 = 0;  // V(M) - V~_R - V~_S
  double coincident_area_mm2 = 0;  // where one surface stands for both, about
  std::vector<bool> is_skin;  // by origin: one side is V~_S or V~_A, but less than 2e-3 mm of it
};

constexpr double kMachineTolerance = 0.02;  // mm

// V~_R, V~_S, V~_A of two placed solids. Bit-identical solids need no boolean: all is reused.
Result<Volumes> ideal_volumes(const TriangleMesh& initial, const TriangleMesh& target,
                              double tolerance_mm = kMachineTolerance);

// Moves pieces of V_R that do not stand on z = 0 to V_T; returns their volume. A piece stands that
// reaches z = 0 and has a foot of 0.1 mm^2: flat, or its cross-section 0.5 mm higher. (What a
// fixture can hold is asked by fixture.h.)
double set_loose_pieces_free(CellComplex& complex);

}  // namespace reforge

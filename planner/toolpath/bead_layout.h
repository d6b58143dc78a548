// One layer's beads: walls along the contour, lines inside.
//
// Purpose: from the region of a layer to the centre lines a nozzle follows. Units: mm. Source: the
// paper's section 7.4 (contour-parallel walls at the bead's width, 30 % infill) and issue text; rig
// file's numbers. Invariants: walls lie half a bead inside the region; what is narrower than 0.8 of
// two beads gets one centre line instead of vanishing; infill lines of following layers cross at
// right angles; their spacing makes lines and links together fill the stated share. Limits: a
// bead's width is constant, so ribs of 0.5 to 0.8 mm are underfilled and ribs of 0.8 to 1 mm
// overfilled.
#pragma once

#include "planner/toolpath/region.h"

namespace reforge {

struct Bead {
  Polyline line;
  bool closed = false;
};

struct BeadOptions {
  double width_mm = 0.5;
  double infill = 0.3;
  int walls = 2;
};

// `solid` is the part of the layer that is filled wholly (it shows above or below). Beads come
// island by island, inner walls first.
std::vector<Bead> lay_beads(const PlaneRegion& layer, const PlaneRegion& solid, bool turned,
                            const BeadOptions& options);

}  // namespace reforge

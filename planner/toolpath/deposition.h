// Deposition: a block printed layer by layer along its direction, from its base up.
//
// Purpose: beads of every layer, in paths that begin above what is printed, extrude, coast and end.
// Units: mm, the block's frame; tips are the nozzle's. Source: section 7.4 of the paper; rig file.
// Invariants: a bead is laid only on something (the block's ground or the layer below, which it may
// overhang by 0.3 mm a layer, about 56 degrees) and only where the nozzle clears `obstacles`; what
// that leaves out is counted, never printed in the air. Travels rise above the layer and above
// obstacles; feed is constant in a path. Limits: no supports and no bridges are planned; minimum
// layer time is not kept.
#pragma once

#include <functional>

#include "planner/machine/tool.h"
#include "planner/toolpath/toolpath.h"
#include "protocols/rig.h"

namespace reforge {

struct DepositionOptions {
  Extrusion extrusion;
  Nozzle nozzle;
  double outlet_radius_mm = 0.25;
  int walls = 2;
  int solid_layers = 3;  // above and below where the block's surface shows
};

DepositionOptions deposition_options(const RigDescription& rig, Mode mode);

struct Deposition {
  std::vector<Path> paths;
  double planned_mm3 = 0;  // sum over layers of (walls + solid + infill x interior) x layer height
  double bead_mm3 = 0;     // sum over beads of length x width x layer height
  double unsupported_mm3 = 0;  // of the block, left out: nothing beneath
  double blocked_mm3 = 0;      // of the block, left out: the nozzle would collide
  double hanging_mm3 = 0;      // beads of printable layers left out over gaps below
  int layers = 0;
};

// `ground` is what the block may stand on (V_R, earlier blocks); `obstacles` what the nozzle must
// clear (V_R; in strict mode all that stands).
Deposition deposit(const DepositionOptions& options, const TriangleMesh& block, const Frame& frame,
                   const std::vector<const TriangleMesh*>& ground,
                   const std::vector<const TriangleMesh*>& obstacles,
                   const std::function<bool()>& interrupted);

}  // namespace reforge

// Deposition: a block printed layer by layer along its direction, from its base up.
//
// Purpose: beads of every layer, in paths that begin above what is printed, extrude, coast and end.
// Units: mm, s, the block's frame; tips are the nozzle's. Source: section 7.4 of the paper; rig
// file. Invariants: a bead is laid only on something that is there by then (V_R, beads of earlier
// blocks, or the layer below, which it may overhang by 0.3 mm a layer, about 56 degrees) and only
// where the nozzle clears `obstacles`; what that leaves out is counted, never printed in the air.
// Travels rise above the layer and above obstacles; feed is constant in a path and the same for a
// whole layer. Limits: gaps up to 2 mm are bridged, wider ones are left out: there are no supports.
#pragma once

#include <functional>
#include <span>

#include "planner/machine/tool.h"
#include "planner/toolpath/toolpath.h"
#include "protocols/rig.h"

namespace reforge {

struct DepositionOptions {
  Extrusion extrusion;
  Nozzle nozzle;
  double outlet_radius_mm = 0.25;
  int walls = 2;
  int solid_layers = 3;       // above and below where the block's surface shows
  double layer_s_min = 4;     // a layer gets this long to set: small layers are printed slower,
  double slowest_feed = 0.4;  // but not below this share of their feed
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

// What a block meets.
struct PrintSite {
  std::vector<const TriangleMesh*> ground;     // what it may stand on: V_R
  std::span<const BlockToolpath> printed;      // likewise: beads of earlier blocks (mills: ignored)
  std::vector<const TriangleMesh*> obstacles;  // the nozzle clears: V_R; strict, all that stands
};

Deposition deposit(const DepositionOptions& options, const TriangleMesh& block, const Frame& frame,
                   const PrintSite& site, const std::function<bool()>& interrupted);

}  // namespace reforge

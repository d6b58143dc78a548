// V_S milled away block by block: each direction roughed and finished on the stock its predecessors
// left.
//
// Units: mm, part frame. Invariants: blocks remove disjoint sets of voxels; no block's toolpath is
// empty. Each piece of surface is finished from the chosen direction that looks at it most
// squarely; what a block could not finish (stock in the holder's way) is tried again from later
// ones, and once more at the end.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "planner/toolpath/machined_surface.h"
#include "planner/toolpath/milling.h"

namespace reforge {

struct MilledBlock {
  BlockToolpath toolpath;
  BitSet removed;  // voxels of the stock
  double removed_mm3 = 0;
};

struct Milling {
  std::vector<MilledBlock> blocks;
  size_t samples = 0;  // of the machined surface
  size_t samples_finished = 0;
  size_t samples_touchable = 0;  // from some chosen direction, V_R and fixture considered
  double left_mm3 = 0;           // rest that stays, but for the skin next to V_R
};

Milling mill_blocks(const MillingOptions& options, const Surroundings& solids,
                    const std::vector<MachinedSample>& surface, const std::vector<Vec3>& directions,
                    const std::function<bool()>& interrupted,
                    const std::function<void(const std::string&)>& progress, PartStock& stock);

}  // namespace reforge

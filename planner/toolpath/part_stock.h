// The stock between blocks: which voxels of the initial solid are still there.
//
// Purpose: carry what milling removed from one direction to the next. Units: mm, part frame.
// Invariants: keep is a subset of present, always: what belongs to V_R is never counted as removed.
// Limits: a voxel is decided by its centre, so the stock's surface is uncertain by half a pitch;
// blocks that need it finer (finishing, links) add that much. Exact solids bound it from both
// sides: never above M, never below V_R.
#pragma once

#include "planner/geometry/bit_set.h"
#include "planner/geometry/voxel_set.h"

namespace reforge {

struct PartStock {
  VoxelSet voxels;  // of M
  BitSet present;
  BitSet keep;       // of V_R
  BitSet near_keep;  // not in V_R, but a face, edge or corner neighbour of it: left to finishing

  // Voxels that are to go and still there.
  BitSet rest() const;
  double volume_mm3(const BitSet& of) const {
    return static_cast<double>(of.count()) * voxels.voxel_volume();
  }
};

// At most about `voxels_max` voxels in M's box, the pitch between 0.25 and 1 mm.
PartStock part_stock(const TriangleMesh& initial, const TriangleMesh& reused,
                     double voxels_max = 3e6);

}  // namespace reforge

// A set of voxels as a closed mesh: what a milling block removes, for a person to look at.
//
// Units: mm, part frame. The surface is made of voxel faces, so it steps by a pitch; its volume is
// that of the voxels. Invariant: closed, and voxels that meet only at a corner or along an edge
// share no vertex there: each one's is drawn in by 1e-3 of a pitch.
#pragma once

#include "planner/geometry/bit_set.h"
#include "planner/geometry/voxel_set.h"

namespace reforge {

TriangleMesh voxel_solid(const VoxelSet& voxels, const BitSet& subset);

}  // namespace reforge

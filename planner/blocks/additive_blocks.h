// V_A taken apart into blocks that are printed one after another, each along one direction from its
// base.
//
// Purpose: connected parts of V_A, each with the printing bases it stands on; a part on several
// facets is cut by the facets' planes, what lies beyond the fewest of them first; blocks ordered so
// that what is printed is least in the nozzle's way to what follows. Source: paper, section 6.
// Units: mm, part frame. Invariants: blocks are closed solids by exact cuts (plane_cut.h); their
// volumes sum to V_A's. Limits: a part with bases that look different ways is printed from the
// largest one whole; blocks are not split into self-supporting ones: what hangs is left out by
// deposition.h and counted. Slice-against-slice collisions are judged block against block, by
// sample points.
#pragma once

#include <vector>

#include "planner/machine/tool.h"
#include "planner/reuse/reuse_plan.h"
#include "protocols/result.h"

namespace reforge {

struct AdditiveBlock {
  TriangleMesh solid;
  Vec3 direction;
};

// In the order of printing. Errors: kBooleanFailed.
Result<std::vector<AdditiveBlock>> additive_blocks(const TriangleMesh& added,
                                                   const std::vector<PrintingBase>& bases,
                                                   const Nozzle& nozzle);

// Parts of a surface that share no vertex; enclosed cavities stay with what encloses them.
std::vector<TriangleMesh> connected_parts(const TriangleMesh& solid);

}  // namespace reforge

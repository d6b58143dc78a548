// V_A taken apart into blocks that are printed one after another, each along one direction from its
// base.
//
// Purpose: connected parts of V_A, each with the printing bases it stands on; a part on several
// facets is cut by the facets' planes; where the nozzle could not follow or matter would hang, a
// part is cut again by a plane and printed on from there along that plane's normal; blocks ordered
// so that what is printed is least in the nozzle's way to what follows. Source: paper, section 6;
// planes as printing bases after Wu et al. 2020. Units: mm, part frame. Invariants: blocks are
// closed solids by exact cuts (plane_cut.h); their volumes sum to V_A's. Limits: cuts are chosen
// greedily on samples (print_outlook.h); a part with bases that look different ways starts from the
// largest one. Slice-against-slice collisions are judged block against block, on samples.
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

struct PrintScene {
  const TriangleMesh& target;
  std::vector<const TriangleMesh*> obstacles;  // what the nozzle must clear: V_R, fixture
  std::vector<Vec3> directions;                // in which the nozzle may come
  bool blocks_collide;  // printed blocks are obstacles to later ones (strict mode)
};

// In the order of printing. Errors: kBooleanFailed.
Result<std::vector<AdditiveBlock>> additive_blocks(const TriangleMesh& added,
                                                   const std::vector<PrintingBase>& bases,
                                                   const Nozzle& nozzle, const PrintScene& scene);

// Parts of a surface that share no vertex; enclosed cavities stay with what encloses them.
std::vector<TriangleMesh> connected_parts(const TriangleMesh& solid);

}  // namespace reforge

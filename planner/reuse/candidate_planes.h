// Candidate clipping planes for a printing base (paper.md 4.1), and the first choice among them.
//
// Symbols: c~_{i,j} the candidate of base b_i with normal n_j, through the point of b_i nearest to
// the
//   fabrication base along n_j; s_{i,j} the bases it serves; W_{i,j} the share of V~_R it takes.
// Departs from the paper: planes cut locally (clipping.h), and normals suggested by the base itself
// are
//   tried besides the uniform ones, because they serve better (REUSE-NOTES.md).
#pragma once

#include <string>
#include <vector>

#include "planner/reuse/clipping.h"

namespace reforge {

// Unit normals with z >= 0: the base's mean normal, two rings around it, +z, then `uniform`
// directions.
std::vector<Vec3> candidate_normals(const BaseComponent& base, int uniform);

struct FirstChoice {
  std::vector<std::shared_ptr<Cut>> cuts;  // by slot
  std::vector<std::size_t> unserved;       // required slots that no candidate serves
};
// Solves Eq. 2 over the required slots' candidates.
FirstChoice first_choice(const ClippingModel& model);

}  // namespace reforge

// Where the target lies in respect of the initial part (paper.md, section 5).
//
// stored: both files keep their common coordinates; the initial part's placement holds for both.
// centroids: both stand on z = 0, and the centroids of their cross-sections 0.5 mm above the bottom
//   agree.
// search: these two, and the best distinct poses of setup_search.h, by how much of the target's
//   volume lies in what they have in common and stands on the base. Repairs arrive registered, and
//   unturned coordinates stay exact: a turned pose must offer a hundredth of M* more.
// paper: the published procedure (setup_paper.h).
// Units: mm, part frame. Translations of whole 2^-10 mm keep coordinates exact (mesh_check.h).
#pragma once

#include <string>
#include <vector>

#include "planner/geometry/mesh_check.h"
#include "planner/reuse/reuse.h"

namespace reforge {

struct PlacedTarget {
  TriangleMesh mesh;  // rounded to float
  Placement placement;
  std::string setup;  // stored, centroids, search or paper
  double share = 0;   // search: standing V~_R / M* by samples; else 0
};

// Candidates in order of preference, at most four; none of them below z = 0 or outside the working
// space. Empty: `why` says for each what is wrong with it.
std::vector<PlacedTarget> place_target(const LoadedPart& initial, const LoadedPart& target,
                                       const RigDescription& rig, Setup setup,
                                       std::vector<std::string>& why);

// Area centroid of the cross-section at height z, in x and y; its z is the height.
Vec3 section_centroid(const TriangleMesh& solid, double z);

}  // namespace reforge

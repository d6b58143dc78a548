// What the reuse chain hands to the blocks: the three volumes, and where printing starts.
//
// Symbols (paper.md, appendix A): M initial, M* target; V~_R, V~_S, V~_A the ideal volumes of the first
// Boolean operation; V_R reused, V_T = V~_R - V_R removed and then added again, V_S = V~_S + V_T removed,
// V_A = V~_A + V_T added. All meshes are in the part frame, mm.
#pragma once

#include <string>
#include <vector>

#include "planner/geometry/mesh.h"
#include "planner/geometry/plane.h"

namespace reforge {

// A connected component of the final printing base B = boundary(V_R) ∩ boundary(V_A): plano-convex,
// so it consists of one or more planar facets.
struct PrintingBase {
  std::vector<Plane> facets;   // planes of its facets; each normal points out of V_R, into V_A
  Vec3 print_direction;        // along the nozzle, out of the base; a nozzle direction found accessible
  bool from_clipping = false;  // made by a clipping plane (else it was plano-convex from the start)
};

// A local clipping plane c^L: cuts only the component of V_T that it belongs to.
struct LocalPlane {
  Plane plane;
  Vec3 seed;  // a point inside the component of V_T this plane cuts off
};

struct ReusePlan {
  TriangleMesh initial, target;            // M, M*: placed
  TriangleMesh ideal_reused;               // V~_R
  TriangleMesh ideal_removed, ideal_added; // V~_S, V~_A
  TriangleMesh reused, removed, added;     // V_R, V_S, V_A
  TriangleMesh then_added;                 // V_T
  std::vector<LocalPlane> planes;
  std::vector<PrintingBase> bases;
  std::vector<Vec3> cutter_directions;     // directions from which every sample of V_S is accessible
  std::vector<Vec3> nozzle_directions;     // likewise for V_A

  // Columns of the paper's Table 1.
  double base_height_ratio = 1;            // B: lowest z of the initial printing base / height of M
  int inaccessible_cutter_points = 0;      // P_S, against V~_R
  int inaccessible_nozzle_points = 0;      // P_A
  double ratio_ideal = 0;                  // R_V = V~_R / M*
  double ratio_initialised = 0;            // R_I after the first stage / M*
  double ratio_final = 0;                  // R_F = V_R / M*
  int global_planes = 0;                   // C_b
  int local_planes = 0;                    // C_a
};

// No plan exists under the constraints: what stays uncovered or blocked, in sentences.
struct Infeasible {
  std::vector<std::string> reasons;
};

}  // namespace reforge

// What the reuse chain hands to the blocks: the volumes, and where printing starts.
//
// Symbols (paper.md, appendix A): M initial, M* target; V~_R, V~_S, V~_A the ideal volumes of the
// first Boolean operation; V_R reused, V_T = V~_R - V_R removed and then added again, V_S = V~_S +
// V_T removed, V_A = V~_A + V_T added. All meshes are in the part frame, mm.
//
// Invariants: V_R, V_S, V_A and V_T are closed and share their borders facet by facet
// (cell_complex.h), so V_R + V_S + dropped = V(M) and V_R + V_A + dropped = V(M*) to rounding; an
// empty one has no triangles. Where a volume touches itself along an edge, that edge has more than
// two triangles.
#pragma once

#include <string>
#include <vector>

#include "planner/geometry/mesh.h"
#include "planner/geometry/mesh_check.h"
#include "planner/geometry/plane.h"

namespace reforge {

// A connected component of the final printing base B = boundary(V_R) ∩ boundary(V_A): plano-convex,
// so it consists of one or more planar facets. Or a patch of the table, where matter is printed
// that V_R does not carry (paper mode only).
struct PrintingBase {
  std::vector<Plane> facets;  // planes of its facets; each normal points out of V_R, into V_A
  Vec3 print_direction;  // along the nozzle, out of the base; a nozzle direction found accessible
  Vec3 point;            // a point on it
  double area_mm2 = 0;
  bool from_clipping = false;  // made by a clipping plane (else it was plano-convex from the start)
  bool on_table = false;
};

// A local clipping plane c^L: cuts only the component of V_T that it belongs to.
struct LocalPlane {
  Plane plane;
  Vec3 seed;  // a point inside the component of V_T this plane cuts off
};

// Counts of the last test of the exact volumes. Its samples are not the search's, but for those
// that failed in an earlier audit: these the search has learned to watch.
struct ReuseAudit {
  int cutter_points = 0, nozzle_points = 0;    // tested
  int cutter_blocked = 0, nozzle_blocked = 0;  // out of reach: none in a feasible plan
  int beneath_base =
      0;  // not counted above: so near the table that the ball would have to be below it
  int bases = 0, bases_not_plano_convex = 0;  // none of the latter in a feasible plan
};

// How much the search did.
struct EffortSpent {
  long volume_evaluations = 0;  // clippings whose kept volume was counted
  long feasibility_checks = 0;  // of them, those tested against every watched and cap point
  int audits = 0, audits_failed = 0;
};

struct ReusePlan {
  TriangleMesh initial, target;  // M, M*: placed
  Placement initial_placement, target_placement;
  TriangleMesh fixture;       // pedestal and table disc, strict mode; empty in paper mode
  TriangleMesh ideal_reused;  // V~_R
  TriangleMesh ideal_removed, ideal_added;  // V~_S, V~_A
  TriangleMesh reused, removed, added;      // V_R, V_S, V_A
  TriangleMesh then_added;                  // V_T
  double dropped_mm3 = 0;                   // slivers that no tool could cut or lay
  std::vector<LocalPlane> planes;
  std::vector<PrintingBase> bases;      // every connected contact of V_R and V_A
  std::vector<Vec3> cutter_directions;  // few directions that together reach every sample of V_S
  std::vector<Vec3> nozzle_directions;  // likewise for V_A; the bases' own first
  std::string setup;                    // how M* was placed: stored, centroids
  ReuseAudit audit;
  std::vector<std::string> notes;  // sentences for the report

  // Columns of the paper's Table 1.
  double base_height_ratio = 1;        // B: lowest z of the initial printing base / height of M
  int inaccessible_cutter_points = 0;  // P_S, against V~_R
  int inaccessible_nozzle_points = 0;  // P_A
  double ratio_ideal = 0;              // R_V = V~_R / M*
  double ratio_initialised = 0;        // R_I after the first stage / M*, sampled
  double ratio_final = 0;              // R_F = V_R / M*
  int global_planes = 0;               // C_b: planes of the first stage
  int local_planes = 0;                // C_a: local planes in the end
  double sampled_error = 0;            // sampled V_R / exact V_R - 1
  EffortSpent effort_spent;
};

// No plan exists under the constraints: what stays uncovered or blocked, in sentences. The volumes
// known by then are given for the report; they may be empty.
struct Infeasible {
  std::vector<std::string> reasons;
  TriangleMesh initial, target;
  TriangleMesh ideal_reused, ideal_removed, ideal_added;
  Placement initial_placement, target_placement;
  std::string setup;
  double ratio_ideal = 0;
};

}  // namespace reforge

// From a sampled clipping to exact volumes, and the proof that they can be made.
//
// realise() repeats a clipping's cuts on the labelled complex of the exact volumes: a piece of V_R
// beyond a
//   plane goes if it holds samples the clipping took, or facets of the slot's base.
// audit() tests the result afresh, knowing nothing of the search: every base is plano-convex, every
// sample
//   of the surfaces of V_S and V_A (cut faces included) is within reach of cutter and nozzle,
//   everything to be printed hangs together with V_R or, where allowed, stands on the table.
// Samples so near the table that the ball would have to be below it when touching them from outside
// cannot be
//   reached by any ball cutter whatever is kept; they are counted apart and do not fail the plan.
// Units: mm, part frame. Limits: obstacles are sampled at 0.5 mm (accessibility.h states the
// error).
#pragma once

#include <string>
#include <vector>

#include "planner/reuse/clipping.h"
#include "planner/reuse/reuse_plan.h"
#include "protocols/result.h"

namespace reforge {

struct ExactClipping {
  CellComplex complex;  // regions as in volumes.h
  std::vector<LocalPlane> planes;
};

// Cuts that others make superfluous are left out.
Clipping pruned(const ClippingModel& model, const Clipping& clipping);
Result<ExactClipping> realise(const CellComplex& ideal, const ClippingModel& model,
                              const Clipping& clipping);

struct AuditSettings {
  const ToolBodies& tools;
  const TriangleMesh& fixture;  // may be empty
  const std::vector<Vec3>& directions;
  const std::vector<bool>& is_skin;  // volumes.h
  bool table_may_carry = false;      // printing may start on the table itself
  double sample_distance_mm = 2;
  double pitch_mm = 0.5;
  std::uint64_t seed = 1;
};

struct AuditResult {
  ReuseAudit counts;
  std::vector<std::string> faults;         // sentences; none: the plan is feasible
  std::vector<SurfaceSample> blocked;      // as borders of V~_R again, for the search to watch
  std::vector<std::size_t> blocked_caps;   // slots of the cuts that made the caps, once a sample
  std::vector<std::uint32_t> bad_origins;  // facets of bases that are not plano-convex
  std::vector<PrintingBase> bases;
  std::vector<Vec3> cutter_directions, nozzle_directions;
  bool passed() const { return faults.empty(); }
};
AuditResult audit(const CellComplex& complex, const AuditSettings& settings);

}  // namespace reforge

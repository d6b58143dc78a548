// The part that comes out, held against what was planned: volumes and deviations.
//
// Volumes are sums over the columns of the view from above. Deviations are taken where lines along
// x, y and z meet the target's surface, each line where the surface faces it within 55 degrees:
// distance along the normal from the target to the finished part, positive where material is left.
// A surface is `milled` if it bounds V_R but not M, `kept` if it bounds both, `printed` if it does
// not bound V_R. Within half a millimetre of another kind's surface nothing is judged: there an
// edge decides which is which. Without V_R everything that does not bound M is `milled`. Limits:
// deviations beyond 3 mm count as 3 mm; lines stand max(0.25 mm, pitch) apart.
#pragma once

#include <cstddef>
#include <optional>

#include "planner/verify/stock.h"

namespace reforge::verify {

struct Deviation {
  std::size_t samples = 0;
  double least = 0, p01 = 0, p05 = 0, p50 = 0, p95 = 0, p99 = 0, most = 0;  // mm
  double missing_mm2 = 0;     // surface where more than 0.15 mm is missing
  Vec3 worst = Vec3::Zero();  // where `least` is
};

struct PartOutcome {
  double initial = 0;                              // mm^3, on the same columns
  double reused = 0;                               // of M, still there
  double removed = 0;                              // of M, cut away
  double added = 0;                                // beads, outside of what is left of M
  double kept_cut = 0;                             // of V_R, cut away (if V_R is given)
  double left_over = 0;                            // of M outside V_R, still there
  double added_in_plan = 0;                        // beads inside V_A (if given)
  double plan_covered = 0;                         // of V_A, within an infill gap of a bead
  std::optional<Deviation> milled, kept, printed;  // if the target is given
};

struct PartReference {
  const TriangleMesh* initial = nullptr;
  const TriangleMesh* target = nullptr;
  const TriangleMesh* reused = nullptr;
  const TriangleMesh* added = nullptr;
  double infill_gap_mm = 0;  // between beads of infill
};

PartOutcome judge_part(const Stock& stock, const PartReference& reference, double pitch);

}  // namespace reforge::verify

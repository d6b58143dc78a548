// Poisson-disk samples of the borders between volumes (paper.md, appendix B: S_S and S_A).
//
// What must be reachable there depends on what lies on either side, and for a border of V~_R on
// whether
//   that matter stays (V_R) or goes (V_T). With V_S = V~_S + V_T and V_A = V~_A + V_T:
//     between        matter of V~_R stays          goes
//     V~_S, outside  cutter                        -
//     V~_S, V~_A     cutter and nozzle             -
//     V~_A, outside  nozzle                        -
//     V~_R, V~_S     cutter                        nozzle
//     V~_R, V~_A     nozzle                        cutter
//     V~_R, outside  nothing                       cutter and nozzle
//   After a cut the same follows from V_T as a region of its own; its border with V_R needs both.
// Units: mm, part frame. Facets on the base (z = 0, looking down) are not sampled: they touch the
// table. Invariants: samples of one kind of border keep `distance_mm` from each other; same seed,
// same samples.
#pragma once

#include <cstdint>
#include <vector>

#include "planner/geometry/cell_complex.h"
#include "planner/reuse/volumes.h"

namespace reforge {

struct SurfaceSample {
  Vec3 position;
  Vec3 normal;    // unit; out of V~_R where it borders on it, else from back to front
  Region matter;  // V~_R if it borders on it, else the region behind
  Region other;
  std::uint32_t facet = 0;   // of the complex, on which it lies
  std::uint32_t origin = 0;  // of that facet

  bool borders_reused() const { return matter == kReused; }
  bool needs_cutter(bool reused_goes) const {
    return is_removed(matter, reused_goes) != is_removed(other, false);
  }
  bool needs_nozzle(bool reused_goes) const {
    return is_added(matter, reused_goes) != is_added(other, false);
  }

 private:
  static bool is_removed(Region region, bool reused_goes) {
    return region == kRemoved || region == kThenAdded || (region == kReused && reused_goes);
  }
  static bool is_added(Region region, bool reused_goes) {
    return region == kAdded || region == kThenAdded || (region == kReused && reused_goes);
  }
};

// `is_skin` by origin (volumes.h): a border of V~_R that only a skin covers counts as its outer
// surface; a skin's own surface is not sampled.
std::vector<SurfaceSample> sample_borders(const CellComplex& complex,
                                          const std::vector<bool>& is_skin, double distance_mm,
                                          std::uint64_t seed);

}  // namespace reforge

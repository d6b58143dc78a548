// Search over the local planes' poses for the most reused volume that is feasible (paper.md 4.2).
//
// Annealing on sampled volumes: each step moves one slot's plane (another normal, a small tilt,
// another
//   depth), uses or frees a slot, and is judged by kept samples minus a penalty for every point out
//   of reach; half of the steps are spent near such points. Volume is tested first, reach only if
//   the step could be accepted. Several chains with their own seeds run on two threads; results do
//   not depend on the number of threads.
// Source: REUSE-NOTES.md for what serves; the published Monte-Carlo tree search is not offered yet.
// Limits: one plane a slot; the result is a local optimum.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "planner/reuse/clipping.h"

namespace reforge {

struct SearchOptions {
  std::uint64_t seed = 1;
  int chains = 4;
  int steps = 3000;                   // a chain
  double heat = 1;                    // of the beginning; less stays nearer to the start
  std::function<bool()> should_stop;  // may be empty; asked often, from two threads
};

struct SearchResult {
  std::vector<Clipping> found;  // feasible, the best first
  long volume_evaluations = 0, feasibility_checks = 0;
};

// At most `most` are returned. Chains begin from `starts` in turn, which may be infeasible.
SearchResult local_search(const ClippingModel& model, const std::vector<Clipping>& starts,
                          const SearchOptions& options, std::size_t most);

}  // namespace reforge

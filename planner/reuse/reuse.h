// The reuse chain: from two parts to what is kept, cut off and printed (paper.md, sections 4 and
// 5).
//
// setup → ideal volumes → printing bases → candidate planes → set cover → accessibility → search
// over local planes → exact cuts → audit. The plan returned has passed the audit on its exact
// volumes: every base plano-convex, every sample of V_S and V_A within reach. Among the stages'
// feasible clippings the one that keeps most is taken. Deterministic: same inputs and options, same
// bytes, unless time_limit_s or should_stop cuts the search short. Limits of this version:
// of several setups the first with a plan is taken; one plane per base; paper's Eq. 2 sums weights.
#pragma once

#include <cstdint>
#include <functional>
#include <string_view>
#include <variant>

#include "planner/geometry/mesh_check.h"
#include "planner/reuse/reuse_plan.h"
#include "planner/stage_times.h"
#include "protocols/result.h"
#include "protocols/rig.h"

namespace reforge {

enum class Setup { kSearch, kPaper, kCentroids, kStored };
enum class Effort { kFast, kDefault, kHigh };

struct ReuseOptions {
  Mode mode = Mode::kStrict;
  Setup setup = Setup::kSearch;
  Effort effort = Effort::kDefault;
  std::uint64_t seed = 1;
  double time_limit_s = 0;  // of the search; 0: none
  // Called between steps from one thread: what is going on, and the best R_F so far (0: none yet).
  std::function<void(std::string_view, double)> progress;
  std::function<bool()> should_stop;  // asked often, from several threads
};

Result<std::variant<ReusePlan, Infeasible>> plan_reuse(const LoadedPart& initial,
                                                       const LoadedPart& target,
                                                       const RigDescription& rig,
                                                       const ReuseOptions& options,
                                                       StageTimes& times);

}  // namespace reforge

// The chain: two mesh files and a rig file in, a job folder out. The only place that knows the
// order.
//
// load → reuse (setup, volumes, init, search) → blocks → toolpaths → program → verify → job folder.
// Units: mm. Same inputs, options and seed give the same bytes of everything but the times in
// plan.json, unless a time limit cut the search short. Format: FORMATS.md, "Job folder" and
// "plan.json".
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "planner/reuse/reuse.h"

namespace reforge {

struct PlanRequest {
  std::filesystem::path initial, target, rig, job;
  Mode mode = Mode::kStrict;
  Setup setup = Setup::kSearch;
  Effort effort = Effort::kDefault;
  std::uint64_t seed = 1;
  double time_limit_s = 0;  // 0: none; most of it goes to the search, which keeps its best
  bool replace = false;     // an existing job folder
  std::function<void(std::string_view stage, std::string_view what)> progress;
  std::function<bool()> should_stop;  // asked often, from several threads
};

struct PlanOutcome {
  bool feasible = false;             // a program was written
  bool verified = false;             // and passed
  std::vector<std::string> reasons;  // why not
  std::string json;                  // plan.json as written
};

// Errors: files that cannot be read or are no parts, a place that cannot be written, kInterrupted.
// "No feasible plan" and "the verifier found faults" are outcomes; both leave a job folder.
Result<PlanOutcome> plan(const PlanRequest& request);

}  // namespace reforge

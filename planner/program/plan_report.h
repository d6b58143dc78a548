// plan.json: what was planned, with which inputs, and how long it took (FORMATS.md).
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "planner/program/plan.h"
#include "planner/program/post.h"
#include "planner/stage_times.h"

namespace reforge {

struct BlockReport {
  BlockKind kind;
  Vec3 direction;
  double volume_mm3;
  std::string file;
  BlockFigures figures;
};

struct PlanFacts {
  const PlanRequest& request;
  const RigDescription& rig;
  std::string initial_sha256, target_sha256, program_sha256;
  std::vector<std::string> notes;
  const StageTimes& times;
};

std::string feasible_report(const PlanFacts& facts, const ReusePlan& plan,
                            const std::vector<BlockReport>& blocks, const Program& program);
std::string infeasible_report(const PlanFacts& facts, const Infeasible& why);

}  // namespace reforge

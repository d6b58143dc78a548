#include "planner/program/fabricate.h"

#include <cstdio>

#include "planner/blocks/additive_blocks.h"
#include "planner/blocks/milled_blocks.h"
#include "planner/blocks/subtractive_blocks.h"
#include "planner/blocks/voxel_solid.h"
#include "planner/machine/kinematics.h"
#include "planner/toolpath/deposition.h"

namespace reforge {
namespace {

constexpr double kSurfaceSpacing = 0.5;  // mm between samples of the machined surface
constexpr double kWorthANote = 0.5;      // mm^3

std::string amount(double mm3) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f mm3", mm3);
  return text;
}

class Fabricator {
 public:
  Fabricator(const ReusePlan& plan, const RigDescription& rig, Mode mode,
             const FabricationWatch& watch, StageTimes& times)
      : plan_(plan), rig_(rig), mode_(mode), watch_(watch), times_(times) {}

  Result<Fabrication> run() {
    if (const Status done = mill(); !done) return done.error();
    if (const Status done = print(); !done) return done.error();
    note();
    return std::move(made_);
  }

 private:
  bool stopped() const { return watch_.should_stop && watch_.should_stop(); }
  void say(std::string_view stage, std::string_view what) const {
    if (watch_.progress) watch_.progress(stage, what);
  }
  static Status interrupted() {
    return Status::fail(Code::kInterrupted,
                        "stopped before the job was complete; nothing was written");
  }

  Status mill();
  Status print();
  void note();

  const ReusePlan& plan_;
  const RigDescription& rig_;
  const Mode mode_;
  const FabricationWatch& watch_;
  StageTimes& times_;
  Fabrication made_;
  TriangleMesh leftover_;  // stock that milling had to leave, strict mode's obstacles
};

Status Fabricator::mill() {
  const MillingOptions options = milling_options(rig_, mode_);
  const Surroundings solids{plan_.initial, plan_.reused, plan_.fixture};
  PartStock stock;
  std::vector<MachinedSample> surface;
  std::vector<Vec3> directions;
  {
    const StageTimer timer(times_, "blocks");
    say("blocks", "finding milling directions");
    stock = part_stock(plan_.initial, plan_.reused);
    surface = machined_surface(plan_.reused, plan_.removed, kSurfaceSpacing);
    directions = milling_directions(
        options, solids, stock, surface, plan_.cutter_directions, [&](const Vec3& d) {
          return mode_ == Mode::kPaper || !rotary_solutions(rig_, d, {}).empty();
        });
  }
  Milling milling;
  {
    const StageTimer timer(times_, "toolpaths");
    milling = mill_blocks(
        options, solids, surface, directions, [&] { return stopped(); },
        [&](const std::string& what) { say("toolpaths", what); }, stock);
  }
  if (stopped()) return interrupted();
  const StageTimer timer(times_, "blocks");
  for (MilledBlock& block : milling.blocks) {
    made_.toolpaths.push_back(std::move(block.toolpath));
    made_.solids.push_back({voxel_solid(stock.voxels, block.removed), block.removed_mm3});
  }
  BitSet left = stock.rest();
  left.subtract(stock.near_keep);
  if (mode_ == Mode::kStrict) leftover_ = voxel_solid(stock.voxels, left);
  made_.left_out.milling_mm3 = milling.left_mm3;
  made_.surface_samples = milling.samples;
  made_.surface_touchable = milling.samples_touchable;
  made_.surface_finished = milling.samples_finished;
  return Unit{};
}

Status Fabricator::print() {
  const DepositionOptions options = deposition_options(rig_, mode_);
  const bool strict = mode_ == Mode::kStrict;
  Result<std::vector<AdditiveBlock>> blocks = [&] {
    const StageTimer timer(times_, "blocks");
    say("blocks", "taking the added volume apart");
    PrintScene scene{plan_.target, {&plan_.reused}, plan_.nozzle_directions, strict};
    if (!plan_.fixture.empty()) scene.obstacles.push_back(&plan_.fixture);
    return additive_blocks(plan_.added, plan_.bases, options.nozzle, scene);
  }();
  if (!blocks) return blocks.error();
  const StageTimer timer(times_, "toolpaths");
  // The paper's nozzle minds V_R alone; the rig's minds everything that stands.
  std::vector<const TriangleMesh*> obstacles{&plan_.reused};
  if (strict) obstacles.insert(obstacles.end(), {&plan_.fixture, &leftover_});
  for (size_t i = 0; i < blocks->size(); ++i) {
    say("toolpaths", "printing " + std::to_string(i + 1) + " of " + std::to_string(blocks->size()));
    const AdditiveBlock& block = (*blocks)[i];
    BlockToolpath toolpath;
    toolpath.kind = BlockKind::kPrint;
    toolpath.frame = Frame::along(block.direction);
    Deposition deposition =
        deposit(options, block.solid, toolpath.frame, {{&plan_.reused}, made_.toolpaths, obstacles},
                [&] { return stopped(); });
    if (stopped()) return interrupted();
    made_.left_out.hanging_mm3 += deposition.unsupported_mm3 + deposition.hanging_mm3;
    made_.left_out.blocked_mm3 += deposition.blocked_mm3;
    made_.printed_plan_mm3 += deposition.planned_mm3;
    made_.printed_beads_mm3 += deposition.bead_mm3;
    if (strict) obstacles.push_back(&block.solid);
    if (deposition.paths.empty()) continue;
    toolpath.paths = std::move(deposition.paths);
    made_.toolpaths.push_back(std::move(toolpath));
    made_.solids.push_back({block.solid, volume(block.solid)});
  }
  return Unit{};
}

void Fabricator::note() {
  const LeftOut& left = made_.left_out;
  if (left.milling_mm3 > kWorthANote) {
    made_.notes.push_back("milling leaves " + amount(left.milling_mm3) +
                          " of the removed volume standing, where no chosen direction reaches it");
  }
  if (made_.surface_samples > 0) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "of %zu samples of the milled surface the ball can touch %zu; %zu were finished",
                  made_.surface_samples, made_.surface_touchable, made_.surface_finished);
    made_.notes.emplace_back(text);
  }
  if (left.hanging_mm3 > kWorthANote) {
    made_.notes.push_back(
        amount(left.hanging_mm3) +
        " of the added volume hang over more than layers can carry and are left out");
  }
  if (left.blocked_mm3 > kWorthANote) {
    made_.notes.push_back(amount(left.blocked_mm3) +
                          " of the added volume cannot be reached by the nozzle and are left out");
  }
}

}  // namespace

Result<Fabrication> fabricate(const ReusePlan& plan, const RigDescription& rig, Mode mode,
                              const FabricationWatch& watch, StageTimes& times) {
  return Fabricator(plan, rig, mode, watch, times).run();
}

}  // namespace reforge

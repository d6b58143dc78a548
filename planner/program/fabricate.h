// From the volumes of a reuse plan to blocks with toolpaths, in the order of making.
//
// Purpose: paper, section 6: V_S milled block by block on the stock its predecessors left, V_A
// printed block by block on what its predecessors printed. Units: mm, part frame; toolpaths in
// their block's frame. Invariants: every block has at least one path; milling comes before
// printing.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "planner/reuse/reuse_plan.h"
#include "planner/stage_times.h"
#include "planner/toolpath/toolpath.h"
#include "protocols/result.h"
#include "protocols/rig.h"

namespace reforge {

// What a block removes or adds.
struct BlockSolid {
  TriangleMesh solid;
  double volume_mm3 = 0;
};

// What does not come out as wanted, mm^3; all of it is said in the notes as well.
struct LeftOut {
  double milling_mm3 = 0;  // of V_S, stays: no chosen direction reaches it
  double hanging_mm3 = 0;  // of V_A: more than layers can carry
  double blocked_mm3 = 0;  // of V_A: the nozzle cannot come there
};

struct Fabrication {
  std::vector<BlockToolpath> toolpaths;
  std::vector<BlockSolid> solids;  // of the same blocks
  LeftOut left_out;
  // Samples of the surface that milling makes, half a millimetre apart.
  std::size_t surface_samples = 0, surface_touchable = 0, surface_finished = 0;
  // Deposition, all blocks: sum over layers of (walls + solid + infill x interior) x height, and
  // sum over beads of length x width x height.
  double printed_plan_mm3 = 0, printed_beads_mm3 = 0;
  std::vector<std::string> notes;
};

struct FabricationWatch {
  std::function<void(std::string_view stage, std::string_view what)> progress;
  std::function<bool()> should_stop;  // asked often
};

// Errors: kBooleanFailed, kInterrupted.
Result<Fabrication> fabricate(const ReusePlan& plan, const RigDescription& rig, Mode mode,
                              const FabricationWatch& watch, StageTimes& times);

}  // namespace reforge

#include "planner/machine/tool.h"

#include <algorithm>

namespace reforge {

Cutter cutter_of(const RigDescription& rig, Mode mode) {
  const CutterDescription description =
      mode == Mode::kPaper ? paper_cutter(rig.cutter) : rig.cutter;
  Cutter cutter{description.diameter_mm / 2, description.flute_length_mm, {}};
  for (const ToolSection& section : description.holder) {
    if (std::max(section.r_from_mm, section.r_to_mm) > cutter.ball_radius_mm + 1e-9) {
      cutter.holder.push_back(section);
    }
  }
  return cutter;
}

Nozzle nozzle_of(const RigDescription& rig, Mode mode) {
  return {mode == Mode::kPaper ? paper_nozzle(rig.nozzle).body : rig.nozzle.body};
}

}  // namespace reforge

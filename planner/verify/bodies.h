// The tools as bodies: what must not touch material, as the under sides of a stack of discs.
//
// A tool section (protocols/rig.h) that widens or goes on upwards meets material first with its
// under side; a cone becomes steps of at most 0.25 mm in radius, each as wide as the cone at its
// upper end. Heights from the tool's own tip; offset from the programmed point (the cutter tip) in
// the machine frame. Sections narrower than what is below them are shadowed and left out.
#pragma once

#include <string>
#include <vector>

#include "planner/geometry/mesh.h"
#include "protocols/rig.h"

namespace reforge::verify {

struct Disc {
  double height;
  double radius;  // may be infinite
};

struct Body {
  std::string name;
  Vec3 offset = Vec3::Zero();
  std::vector<Disc> discs;
};

// Under sides of the sections from height `from` on.
std::vector<Disc> under_sides(const std::vector<ToolSection>& sections, double from);

struct ToolBodies {
  double ball_radius;
  Body holder;  // everything above the flutes
  Body nozzle_parked;
  Body nozzle_deployed;
  double mouth_radius;  // of the nozzle's outlet
};

ToolBodies tool_bodies(const CutterDescription& cutter, const NozzleDescription& nozzle);

}  // namespace reforge::verify

// The post-processor: toolpaths of all blocks -> one program for one rig.
//
// Purpose: choose the rotary angles of each block, turn tips into programmed points (the cutter's
// tip; nozzle moves are shifted by the deployed offset), order spindle and extruder, and keep every
// axis within its travel. Units: mm, s; paths in their block's frame. Format: FORMATS.md,
// "program.nc". Invariants: rotary moves and M70/M71 stand at or above the clear height over the
// sphere that the part sweeps; rapids are pure Z or pure XY; extrusion runs at one feed a path;
// each path begins with a comment that numbers it. In strict mode the idle tool and the heads clear
// part, table and fixture in every block. Limits: idle bodies are tested against the whole initial
// and target solids and the fixture, at path points and every 2 mm between, on a 1 mm map widened
// by one cell.
#pragma once

#include <string>
#include <vector>

#include "planner/machine/kinematics.h"
#include "planner/toolpath/toolpath.h"
#include "protocols/rig.h"

namespace reforge {

struct PostJob {
  std::string name;
  Mode mode = Mode::kStrict;
  std::string stock_sha256;
  // Everything that turns with the table, part frame: M, M*, fixture.
  std::vector<const TriangleMesh*> solids;
};

struct BlockFigures {
  RotaryAngles angles;
  double path_mm = 0;  // at feed
  double air_mm = 0;   // at rapid
  double seconds = 0;  // at the stated feeds and rapids, without acceleration
  int paths = 0;
};

struct Program {
  std::string text;
  std::size_t lines = 0;
  std::vector<BlockFigures> blocks;  // as the toolpaths given
  double filament_mm = 0;            // commanded: beads and priming
  int toggles = 0;                   // M72
  int retracts = 0;                  // M74
  std::vector<std::string> notes;
};

// Errors: kUnreachable with block, axis and travel.
Result<Program> post_program(const RigDescription& rig, const PostJob& job,
                             const std::vector<BlockToolpath>& blocks);

}  // namespace reforge

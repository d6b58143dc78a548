// What a block's tool does: moves in the block's tool frame, before any machine is known.
//
// Purpose: the value that roughing, finishing and deposition make and the post turns into program
// text. Units: mm. Frame: the block's own (height_map.h, Frame): x and y are u and v, z is the
// height of the tool tip along the tool. Invariants: the first move of a path is a rapid; rapids
// keep u and v, or keep the height; a rapid never passes through the stock of its moment.
#pragma once

#include <vector>

#include "planner/geometry/height_map.h"

namespace reforge {

enum class Motion {
  kRapid,
  kRamp,   // into material, or down to it
  kLower,  // straight down at the ramp's feed: only the ball's side may touch something
  kCut,
  kDeposit,  // extruding
  kCoast,    // the end of a bead, without extrusion
};

struct Move {
  Vec3 to;
  Motion motion;
};

// One continuous engagement: comes down, works, ends where it stopped.
struct Path {
  std::vector<Move> moves;
  bool first_layer = false;  // deposition: its own feed
  double feed_share = 1;     // of that feed: small layers are printed slower
};

enum class BlockKind { kMill, kPrint };

struct BlockToolpath {
  BlockKind kind = BlockKind::kMill;
  Frame frame;
  std::vector<Path> paths;
};

}  // namespace reforge

// Where beads really lie in a layer, so that the next layer's beads are asked what carries them.
//
// Purpose: a region may be printable and yet be filled sparsely; a bead over a gap hangs. Units:
// mm, the block's frame. Method: a bitmap of kPitch cells stamped along the beads. A place of a
// bead is carried if at least a third of its width lies on the layer below.
#pragma once

#include <functional>

#include "planner/toolpath/bead_layout.h"

namespace reforge {

class BeadCover {
 public:
  BeadCover(const Vec2& low, const Vec2& high);
  void stamp(const Bead& bead, double width);
  bool covered(const Vec2& p) const;

 private:
  Vec2 origin_;
  int columns_, rows_;
  std::vector<char> cells_;
};

// The bead without its stretches that hang over more than `bridge_mm`; `carries` answers for a
// point of the layer below. `lost_mm` grows by what is left out.
std::vector<Bead> carried_parts(const Bead& bead, double width, double bridge_mm,
                                const std::function<bool(const Vec2&)>& carries, double& lost_mm);

}  // namespace reforge

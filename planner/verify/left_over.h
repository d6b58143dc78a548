// Material that was to go, could have gone, and is still there.
//
// From each milling direction the tools leave, at best, the closing of V_R by the ball (corners the
// ball does not reach), and stay higher where holder, fixture or base keep them up. What the
// finished part has beyond that ideal is left over by the program, not by the tools. Only lumps
// count: thinner than three cells is a matter of scallops and of this grid. Part frame, mm. Limits:
// the holder is tested on a 1 mm grid widened by 1.5 mm; stock that stood in the holder's way at
// the time is not considered.
#pragma once

#include <vector>

#include "planner/verify/bodies.h"
#include "planner/verify/stock.h"

namespace reforge::verify {

struct LeftOver {
  double volume_mm3 = 0;      // of lumps
  double thickness_mm = 0;    // of the thickest column of a lump, from above
  Vec3 where = Vec3::Zero();  // in it
};

struct LeftOverQuestion {
  const TriangleMesh& initial;
  const TriangleMesh& reused;
  const TriangleMesh* fixture;  // null: the base z = 0 keeps the tip up instead
  const ToolBodies& tools;
  const std::vector<Vec3>& directions;  // towards the spindle
};

LeftOver find_left_over(const Stock& stock, const LeftOverQuestion& question);

}  // namespace reforge::verify

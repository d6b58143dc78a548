// The part of a plane where a rule holds, as polygons: marching squares with exact crossings.
//
// Purpose: turn "the tool may stand here at this height" into regions that can be offset. Corners
// of the grid are tested; where a grid edge leaves the region the crossing is bisected to pitch /
// 256. Units: mm. Invariants: rings as in region.h; the outermost grid nodes count as outside.
// Limit: what is narrower than the pitch between grid nodes is not seen. Between two crossings the
// ring is a chord: for a boundary of radius r it lies pitch^2 / (4 r) off at most.
#pragma once

#include <functional>

#include "planner/toolpath/region.h"

namespace reforge {

struct PlaneGrid {
  Vec2 origin = Vec2::Zero();
  double pitch = 1;
  int columns = 0, rows = 0;  // nodes

  // Covers low..high with one spare node all around.
  static PlaneGrid covering(const Vec2& low, const Vec2& high, double pitch);
  Vec2 node(int column, int row) const { return origin + pitch * Vec2(column, row); }
  size_t index(int column, int row) const { return static_cast<size_t>(row) * columns + column; }
  size_t size() const { return static_cast<size_t>(columns) * rows; }
};

// `at_node` is the rule at the nodes (grid.index), `rule` anywhere.
PlaneRegion region_where(const PlaneGrid& grid, const std::vector<char>& at_node,
                         const std::function<bool(const Vec2&)>& rule);

}  // namespace reforge

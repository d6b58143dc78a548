// A part of a plane as the nodes of a grid: quick where polygons with thousands of steps are slow.
//
// Purpose: what carries a layer, where the nozzle fits, what shows. Units: mm. Exactness: a node is
// in or out by its own place; an outline runs half way between nodes that are in and nodes that
// are out. Nodes at the grid's rim count as outside in outlines.
#pragma once

#include <cstdint>
#include <vector>

#include "planner/toolpath/level_region.h"

namespace reforge {

class PlaneMask {
 public:
  PlaneMask() = default;
  explicit PlaneMask(const PlaneGrid& grid) : grid_(grid), nodes_(grid.size(), 0) {}
  // Nodes inside the region's rings.
  static PlaneMask of(const PlaneRegion& region, const PlaneGrid& grid);

  const PlaneGrid& grid() const { return grid_; }
  bool none() const;
  std::size_t count() const;
  double area() const { return static_cast<double>(count()) * grid_.pitch * grid_.pitch; }
  bool test(std::size_t node) const { return nodes_[node] != 0; }
  void set(std::size_t node, bool in) { nodes_[node] = in; }
  // At the nearest node.
  bool covers(const Vec2& p) const;

  // Grids are the same.
  PlaneMask& operator&=(const PlaneMask& other);
  PlaneMask& operator|=(const PlaneMask& other);
  PlaneMask& subtract(const PlaneMask& other);
  // By a disc.
  PlaneMask grown(double by_mm) const;
  PlaneMask shrunk(double by_mm) const;
  PlaneRegion outline() const;

 private:
  PlaneGrid grid_;
  std::vector<std::uint8_t> nodes_;
};

}  // namespace reforge

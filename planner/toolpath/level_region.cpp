#include "planner/toolpath/level_region.h"

#include <cassert>
#include <cmath>
#include <map>

namespace reforge {
namespace {

constexpr int kBisections = 8;

// Crossings are named by grid edge: 2 * node for the edge to the right, + 1 for the edge upwards.
using EdgeName = size_t;

class Tracer {
 public:
  Tracer(const PlaneGrid& grid, const std::vector<char>& at_node,
         const std::function<bool(const Vec2&)>& rule)
      : grid_(grid), at_node_(at_node), rule_(rule) {}

  PlaneRegion trace() {
    for (int row = 0; row + 1 < grid_.rows; ++row) {
      for (int column = 0; column + 1 < grid_.columns; ++column) march(column, row);
    }
    std::vector<Polyline> rings;
    while (!next_.empty()) {
      Polyline ring;
      EdgeName edge = next_.begin()->first;
      for (auto link = next_.find(edge); link != next_.end(); link = next_.find(edge)) {
        ring.push_back(crossing(edge));
        edge = link->second;
        next_.erase(link);
      }
      if (ring.size() > 2) rings.push_back(std::move(ring));
    }
    return united(rings);
  }

 private:
  bool in(int column, int row) const {
    if (column <= 0 || row <= 0 || column + 1 >= grid_.columns || row + 1 >= grid_.rows)
      return false;
    return at_node_[grid_.index(column, row)] != 0;
  }
  EdgeName right_of(int column, int row) const { return 2 * grid_.index(column, row); }
  EdgeName above(int column, int row) const { return 2 * grid_.index(column, row) + 1; }

  // Segments of one cell, inside on the left.
  void march(int c, int r) {
    const int code = in(c, r) | in(c + 1, r) << 1 | in(c + 1, r + 1) << 2 | in(c, r + 1) << 3;
    if (code == 0 || code == 15) return;
    const EdgeName south = right_of(c, r), north = right_of(c, r + 1);
    const EdgeName west = above(c, r), east = above(c + 1, r);
    const auto link = [&](EdgeName from, EdgeName to) { next_[from] = to; };
    switch (code) {
      case 1:
        return link(south, west);
      case 2:
        return link(east, south);
      case 3:
        return link(east, west);
      case 4:
        return link(north, east);
      case 6:
        return link(north, south);
      case 7:
        return link(north, west);
      case 8:
        return link(west, north);
      case 9:
        return link(south, north);
      case 11:
        return link(east, north);
      case 12:
        return link(west, east);
      case 13:
        return link(south, east);
      case 14:
        return link(west, south);
      // Saddles: the two inside corners stay apart, which never lets a tool through a gap it was
      // not shown to fit.
      case 5:
        return link(south, west), link(north, east);
      case 10:
        return link(east, south), link(west, north);
      default:
        assert(false);
    }
  }

  Vec2 crossing(EdgeName edge) const {
    const size_t node = edge / 2;
    const int c = static_cast<int>(node % grid_.columns),
              r = static_cast<int>(node / grid_.columns);
    const bool upwards = edge % 2 == 1;
    const int c2 = upwards ? c : c + 1, r2 = upwards ? r + 1 : r;
    Vec2 inner = grid_.node(c, r), outer = grid_.node(c2, r2);
    if (!in(c, r)) std::swap(inner, outer);
    for (int i = 0; i < kBisections; ++i) {
      const Vec2 middle = (inner + outer) / 2;
      (rule_(middle) ? inner : outer) = middle;
    }
    return inner;
  }

  const PlaneGrid& grid_;
  const std::vector<char>& at_node_;
  const std::function<bool(const Vec2&)>& rule_;
  std::map<EdgeName, EdgeName> next_;
};

}  // namespace

PlaneGrid PlaneGrid::covering(const Vec2& low, const Vec2& high, double pitch) {
  PlaneGrid grid;
  grid.pitch = pitch;
  grid.origin = low - Vec2(pitch, pitch);
  grid.columns = static_cast<int>(std::ceil((high.x() - low.x()) / pitch)) + 3;
  grid.rows = static_cast<int>(std::ceil((high.y() - low.y()) / pitch)) + 3;
  return grid;
}

PlaneRegion region_where(const PlaneGrid& grid, const std::vector<char>& at_node,
                         const std::function<bool(const Vec2&)>& rule) {
  assert(at_node.size() == grid.size());
  return Tracer(grid, at_node, rule).trace();
}

}  // namespace reforge

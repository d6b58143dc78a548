#include "planner/toolpath/plane_mask.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace reforge {
namespace {

constexpr double kSmoothing = 0.6;  // of the pitch: stairs of an outline become straight

}  // namespace

PlaneMask PlaneMask::of(const PlaneRegion& region, const PlaneGrid& grid) {
  PlaneMask mask(grid);
  std::vector<std::vector<double>> crossings(static_cast<std::size_t>(grid.rows));
  for (const Polyline& ring : region.rings) {
    for (std::size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++) {
      Vec2 a = ring[j], b = ring[i];
      if (a.y() == b.y()) continue;
      if (a.y() > b.y()) std::swap(a, b);
      // Rows with a.y <= y < b.y: an end belongs to one of two edges.
      const int first =
          std::max(0, static_cast<int>(std::ceil((a.y() - grid.origin.y()) / grid.pitch)));
      for (int row = first; row < grid.rows; ++row) {
        const double y = grid.origin.y() + row * grid.pitch;
        if (y >= b.y()) break;
        crossings[static_cast<std::size_t>(row)].push_back(a.x() + (b.x() - a.x()) * (y - a.y()) /
                                                                       (b.y() - a.y()));
      }
    }
  }
  for (int row = 0; row < grid.rows; ++row) {
    std::vector<double>& line = crossings[static_cast<std::size_t>(row)];
    std::sort(line.begin(), line.end());
    for (std::size_t i = 0; i + 1 < line.size(); i += 2) {
      const int from =
          std::max(0, static_cast<int>(std::ceil((line[i] - grid.origin.x()) / grid.pitch)));
      const int to =
          std::min(grid.columns - 1,
                   static_cast<int>(std::floor((line[i + 1] - grid.origin.x()) / grid.pitch)));
      for (int column = from; column <= to; ++column) mask.nodes_[grid.index(column, row)] = 1;
    }
  }
  return mask;
}

bool PlaneMask::none() const {
  return std::none_of(nodes_.begin(), nodes_.end(), [](std::uint8_t n) { return n != 0; });
}

std::size_t PlaneMask::count() const {
  return static_cast<std::size_t>(std::count(nodes_.begin(), nodes_.end(), 1));
}

bool PlaneMask::covers(const Vec2& p) const {
  const Vec2 d = (p - grid_.origin) / grid_.pitch;
  const int c = static_cast<int>(std::floor(d.x() + 0.5)),
            r = static_cast<int>(std::floor(d.y() + 0.5));
  return c >= 0 && r >= 0 && c < grid_.columns && r < grid_.rows && nodes_[grid_.index(c, r)] != 0;
}

PlaneMask& PlaneMask::operator&=(const PlaneMask& other) {
  assert(nodes_.size() == other.nodes_.size());
  for (std::size_t i = 0; i < nodes_.size(); ++i)
    nodes_[i] = static_cast<std::uint8_t>(nodes_[i] & other.nodes_[i]);
  return *this;
}
PlaneMask& PlaneMask::operator|=(const PlaneMask& other) {
  assert(nodes_.size() == other.nodes_.size());
  for (std::size_t i = 0; i < nodes_.size(); ++i)
    nodes_[i] = static_cast<std::uint8_t>(nodes_[i] | other.nodes_[i]);
  return *this;
}
PlaneMask& PlaneMask::subtract(const PlaneMask& other) {
  assert(nodes_.size() == other.nodes_.size());
  for (std::size_t i = 0; i < nodes_.size(); ++i)
    nodes_[i] = static_cast<std::uint8_t>(nodes_[i] & (other.nodes_[i] ^ 1));
  return *this;
}

PlaneMask PlaneMask::grown(double by_mm) const {
  PlaneMask out(grid_);
  const double radius = by_mm / grid_.pitch;
  const int reach = static_cast<int>(radius);
  const int far = grid_.columns + 1;
  std::vector<int> distance(static_cast<std::size_t>(grid_.columns));
  for (int row = 0; row < grid_.rows; ++row) {
    const std::uint8_t* in = &nodes_[grid_.index(0, row)];
    bool any = false;
    for (int c = 0, d = far; c < grid_.columns; ++c) {
      d = in[c] ? 0 : d + 1;
      any |= in[c] != 0;
      distance[static_cast<std::size_t>(c)] = d;
    }
    if (!any) continue;
    for (int c = grid_.columns - 1, d = far; c >= 0; --c) {
      d = in[c] ? 0 : d + 1;
      distance[static_cast<std::size_t>(c)] = std::min(distance[static_cast<std::size_t>(c)], d);
    }
    for (int dy = -reach; dy <= reach; ++dy) {
      if (row + dy < 0 || row + dy >= grid_.rows) continue;
      const int half = static_cast<int>(std::sqrt(radius * radius - dy * dy));
      std::uint8_t* to = &out.nodes_[grid_.index(0, row + dy)];
      for (int c = 0; c < grid_.columns; ++c)
        to[c] = static_cast<std::uint8_t>(to[c] | (distance[static_cast<std::size_t>(c)] <= half));
    }
  }
  return out;
}

PlaneMask PlaneMask::shrunk(double by_mm) const {
  PlaneMask outside = *this;
  for (std::uint8_t& n : outside.nodes_) n ^= 1;
  PlaneMask out = outside.grown(by_mm);
  for (std::uint8_t& n : out.nodes_) n ^= 1;
  return out;
}

PlaneRegion PlaneMask::outline() const {
  if (none()) return {};
  const std::vector<char> at_node(nodes_.begin(), nodes_.end());
  PlaneRegion region = region_where(grid_, at_node, [&](const Vec2& p) { return covers(p); });
  for (Polyline& ring : region.rings) ring = simplified(ring, kSmoothing * grid_.pitch, true);
  std::erase_if(region.rings, [](const Polyline& ring) { return ring.size() < 3; });
  return united(region.rings);
}

}  // namespace reforge

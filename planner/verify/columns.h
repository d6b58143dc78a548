// Dexels: for every column of a view, where along w there is material.
//
// Intervals of a column are disjoint and ascending. Heights are floats: 1.5e-5 mm at 200 mm. Built
// column by column, in the order of the cells; then constant.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "planner/geometry/mesh.h"
#include "planner/verify/view.h"

namespace reforge::verify {

struct Interval {
  float lo = 0;
  float hi = 0;
};
using Intervals = std::vector<Interval>;

class Columns {
 public:
  Columns() : start_{0} {}

  void reserve(std::size_t columns, std::size_t intervals) {
    start_.reserve(columns + 1);
    items_.reserve(intervals);
  }
  // The next column.
  void push(std::span<const Interval> intervals) {
    items_.insert(items_.end(), intervals.begin(), intervals.end());
    start_.push_back(static_cast<std::uint32_t>(items_.size()));
  }

  // The columns of another, behind these.
  void append(const Columns& more);

  std::size_t size() const { return start_.size() - 1; }
  std::span<const Interval> at(std::size_t column) const {
    return {items_.data() + start_[column], items_.data() + start_[column + 1]};
  }
  std::size_t intervals() const { return items_.size(); }
  double length() const;  // sum of all intervals, mm; times pitch^2 it is a volume

 private:
  std::vector<std::uint32_t> start_;
  Intervals items_;
};

// The columns of a solid. Exactly watertight for a closed mesh: vertices are snapped to 1/1024 of a
// cell across (heights are not), and shared edges are owned by one of their triangles.
Columns rasterise(const TriangleMesh& mesh, const View& view);

// Where the columns of a view meet a mesh's surface: the height, and the cosine between the outward
// normal and w (positive: an upper side).
struct SurfaceSample {
  std::uint32_t cell;
  float w;
  float cosine;
};
std::vector<SurfaceSample> sample_surface(const TriangleMesh& mesh, const View& view);

// Adds one interval to ascending, disjoint ones; parts closer than `gap` become one.
void unite(Intervals& intervals, Interval added, float gap);
// a minus b, both ascending and disjoint; `out` is overwritten.
void subtract(std::span<const Interval> a, std::span<const Interval> b, Intervals& out);
// Total length of the part that a and b share.
double shared_length(std::span<const Interval> a, std::span<const Interval> b);

}  // namespace reforge::verify

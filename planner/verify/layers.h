// What one block did to the stock, in the block's own view: a cut surface, or the deposited dexels.
//
// The stock is the initial solid and the layers in order (stock.h); nothing is resampled on the
// way, so errors do not add up from block to block: a cut is exact along its tool and one cell wide
// across, a deposit is one cell wide across.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "planner/verify/columns.h"

namespace reforge::verify {

// A rectangle of cells, [i0, i1) x [j0, j1).
struct CellRect {
  int i0 = 0, j0 = 0, i1 = 0, j1 = 0;

  bool empty() const { return i0 >= i1 || j0 >= j1; }
  int width() const { return i1 - i0; }
  int height() const { return j1 - j0; }
  void include(const CellRect& other);
};

// Bounds of a scalar over 2^k x 2^k cells, k = 1, 2, ...: for skipping.
class BoundsPyramid {
 public:
  BoundsPyramid() = default;
  BoundsPyramid(const std::vector<float>& low, const std::vector<float>& high, int width,
                int height);

  struct Range {
    float low;
    float high;
  };
  // A range that holds every cell of the rectangle (inclusive, inside the grid).
  Range over(int i0, int j0, int i1, int j1) const;
  std::size_t bytes() const;

 private:
  struct Level {
    int width, height;
    std::vector<Range> nodes;
  };
  std::vector<Level> levels_;  // levels_[0]: 2 x 2 cells
};

// A straight line in a layer's view: x, y in cells from the layer rectangle's first cell centre,
// w in mm; all linear in the line's own parameter t (mm).
struct LayerLine {
  double x, y, w;     // at t = 0
  double dx, dy, dw;  // per mm
};

// The stretch [t0, t1] of a line that is asked about; nothing if t0 >= t1.
struct LineStretch {
  LayerLine line;
  double t0, t1;
};

// Everything above `surface` was removed along w; +infinity where nothing was.
class CutLayer {
 public:
  CutLayer(const View& view, const CellRect& rect, const std::vector<float>& surface_of_view);

  const View& view() const { return view_; }
  const CellRect& rect() const { return rect_; }
  std::size_t bytes() const;
  // For lines that run side by side (same dx, dy, dw; the closer the cheaper): removed[k] receives
  // the parts of line k's stretch that were cut, ascending.
  void removed_on(std::span<const LineStretch> lines, std::span<Intervals> removed) const;

 private:
  double surface(double x, double y) const;  // bilinear between cell centres, but at walls

  View view_;
  CellRect rect_;
  std::vector<float> surface_;
  BoundsPyramid bounds_;
};

// What was printed: dexels over the rectangle.
class DepositLayer {
 public:
  DepositLayer(const View& view, const CellRect& rect, Columns columns);

  const View& view() const { return view_; }
  const CellRect& rect() const { return rect_; }
  const Columns& columns() const { return columns_; }
  std::size_t bytes() const;
  // For lines that run side by side: unites with deposited[k] the parts of line k's stretch that
  // lie in the deposit.
  void added_on(std::span<const LineStretch> lines, std::span<Intervals> deposited) const;

 private:
  void add_in_cell(const LayerLine& line, double t0, double t1, Intervals& deposited) const;

  View view_;
  CellRect rect_;
  Columns columns_;
  BoundsPyramid bounds_;
};

}  // namespace reforge::verify

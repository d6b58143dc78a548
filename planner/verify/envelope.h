// The upper envelope of material in a view, and how far a moving body stays from it.
//
// Tools are upward-closed: with its tip at p a tool is in material exactly if, somewhere under its
// profile, the highest material of that column is above p + profile(radius). The envelope is a
// height per column with a pyramid of maxima (8 x 8 per level), so that a wide body over low
// material costs a few look-ups.
//
// Heights may be raised (deposits, eager) or lowered (cuts, lazy: the owner marks a rectangle and
// gives a function for the exact height). Columns without material are -infinity. Units: mm; i, j
// are cells of the view. Lateral resolution: one cell; a body is tested at cell centres.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "planner/verify/columns.h"
#include "planner/verify/layers.h"

namespace reforge::verify {

// A flat disc (the under side of a tool section) moving in a straight line, in view coordinates:
// centres a to b. An infinite radius is a plane. The disc at every point is taken at the move's
// lowest height.
struct SweptDisc {
  Vec3 a, b;
  double radius;
};

class Envelope {
 public:
  Envelope(const View& view, std::vector<float> top);
  // Of a solid.
  Envelope(const TriangleMesh& mesh, const View& view);

  const View& view() const { return view_; }
  float top(std::size_t cell) const { return top_[cell]; }
  float highest() const;  // of everything; may be stale upwards

  void raise(int i, int j, float height);
  // The heights in the rectangle may have become lower; `exact` tells, when asked.
  void mark_lowered(const CellRect& rect);
  // Brings every height up to date.
  void settle();
  void set_exact(std::function<float(std::size_t)> exact) { exact_ = std::move(exact); }

  // The smallest gap between the disc and material, if below `best`; else `best`. The gap to one
  // column is the larger of the vertical and the lateral one: by so much the body could grow both
  // ways. Negative: penetration. `where` receives the column's top when the result is below `best`.
  double gap(const SweptDisc& disc, double best, Vec3* where = nullptr);

  // The largest depth by which a ball end of this radius, tip moving from a to b, enters material,
  // if above `least`; else `least`.
  double ball_depth(const Vec3& a, const Vec3& b, double radius, double least,
                    Vec3* where = nullptr);

 private:
  static constexpr int kLevels = 3;  // above the cells
  struct Level {
    int shift = 0;  // cells per node, as a power of two
    int width = 0, height = 0;
    std::vector<float> highest;
    std::vector<std::uint16_t> stale;  // marks since the last refresh
  };
  void refresh(int level, int i, int j);
  template <typename Keep, typename Leaf>
  void descend(int level, const CellRect& box, int i0, int j0, int i1, int j1, const Keep& keep,
               const Leaf& leaf);
  CellRect around(const Vec3& a, const Vec3& b, double reach) const;

  View view_;
  std::vector<float> top_;
  std::array<Level, kLevels> levels_;
  std::function<float(std::size_t)> exact_;
};

// As Envelope::gap, for a move that also rises or falls: split until the heights differ little.
double swept_gap(Envelope& envelope, const SweptDisc& disc, double best, Vec3* where = nullptr);

// Lower surface of a ball end swept from tip a to tip b, at (u, v); +infinity outside.
double swept_ball_height(const Vec3& a, const Vec3& b, double radius, double u, double v);

}  // namespace reforge::verify

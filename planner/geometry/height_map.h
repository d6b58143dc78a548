// Height maps: the upper envelope of solids along a direction, and what a tool coming from there
// can reach (DESIGN.md, idea 2).
//
// A tool that only widens upwards, its tip at p and its axis along d, meets a solid exactly if
// somewhere under its profile the solid's upper envelope along d is above p + profile. So:
// rasterise the solid once for each direction, widen the map once by the tool's profile, and every
// later question is one look-up:
//
//     HeightMap tips = tip_heights(envelope, nozzle.body);       // once for a direction
//     bool collides = tips.lookup(p) > p.dot(direction);         // for each point
//
// Units: mm. Frame: heights are measured along frame.d from the part frame's origin, so that the
//   height of a point p is p . d; columns run along frame.u, rows along frame.v.
// Invariants: a height is finite or kEmpty (-infinity: nothing there, and everywhere off the grid).
// Exactness: a cell stands for its centre. With Sampling::kCentres a height is exact at the centre
//   and says nothing of the rest of the cell; with kConservative it is no lower than anything above
//   the cell. A disc covers the cells whose centres are nearer than its radius: touching is not
//   meeting. Callers that must never touch add pitch / sqrt(2) to the radius and use kConservative.
#pragma once

#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "planner/geometry/mesh.h"
#include "protocols/rig.h"

namespace reforge {

// Right-handed orthonormal axes with d pointing up along the tool.
struct Frame {
  Vec3 u, v, d;

  // u is horizontal; for d = +z the axes are the part frame's own.
  static Frame along(const Vec3& unit_direction);
  Vec3 to_local(const Vec3& part) const { return {u.dot(part), v.dot(part), d.dot(part)}; }
  Vec3 to_part(const Vec3& local) const { return local.x() * u + local.y() * v + local.z() * d; }
};

// Where the cells lie: cell (column i, row j) is centred on (u0 + i pitch, v0 + j pitch).
struct HeightGrid {
  Frame frame;
  double pitch_mm = 1;
  double u0 = 0, v0 = 0;
  int columns = 0, rows = 0;

  // The grid over the projection of `box` (part frame), `margin_mm` wider on every side. Centres
  // are at (integer + 1/2) * pitch, so grids of one frame and pitch fit together.
  static HeightGrid over(const Frame& frame, double pitch_mm, const Box3& box, double margin_mm);
  // The same over everything in `points` (tighter than a box's corners when the frame is tilted).
  static HeightGrid over(const Frame& frame, double pitch_mm, std::span<const Vec3> points,
                         double margin_mm);

  Vec3 centre(int column, int row, double height) const;  // part frame
};

enum class Sampling { kCentres, kConservative };

struct HeightMap {
  static constexpr float kEmpty = -std::numeric_limits<float>::infinity();

  HeightGrid grid;
  std::vector<float> heights;  // row by row

  explicit HeightMap(const HeightGrid& over)
      : grid(over), heights(static_cast<std::size_t>(over.columns) * over.rows, kEmpty) {}

  float at(int column, int row) const { return heights[index(column, row)]; }
  float& at(int column, int row) { return heights[index(column, row)]; }
  bool contains(int column, int row) const {
    return column >= 0 && row >= 0 && column < grid.columns && row < grid.rows;
  }
  // The height of the cell that holds `part_point`'s projection.
  float lookup(const Vec3& part_point) const;

 private:
  std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * grid.columns + column;
  }
};

// Raises `map` to the envelope of a closed, outward-oriented mesh (parts off the grid are left
// out).
void raise_to(HeightMap& map, const TriangleMesh& solid, Sampling sampling);
HeightMap upper_envelope(const HeightGrid& grid, const TriangleMesh& solid, Sampling sampling);

// Each cell becomes the highest of all cells whose centres are nearer than `radius_mm`. Time:
// cells x (about 3 radius / pitch), vectorised.
HeightMap dilated(const HeightMap& map, double radius_mm);

// The height of a tool's tip when it just touches: max over cells q nearer than `radius_mm` of
// map(q) - underside(|q - p|), where `underside` is the tool's lowest point at a distance from its
// axis, measured from the tip; +infinity where the tool has nothing. Time: cells x (radius /
// pitch)^2 x 3.
HeightMap tip_heights(const HeightMap& map, double radius_mm,
                      const std::function<double(double)>& underside);
// Of a ball end: the tool-offset surface of the tip.
HeightMap tip_heights_of_ball(const HeightMap& map, double radius_mm);
// Of a stack of cylinders and cones, taken as upward closed: what is narrower above is counted as
// wide as what is below it. A radius may be infinite. `widen_mm` is added to every finite radius.
HeightMap tip_heights(const HeightMap& map, std::span<const ToolSection> sections,
                      double widen_mm = 0);

// Cell by cell the higher of the two (equal grids).
void raise_to(HeightMap& map, const HeightMap& other);

}  // namespace reforge

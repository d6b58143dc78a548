// The stock as one milling block sees it: height maps along its tool, lowered as the cutter passes.
//
// Purpose: where is something left to cut, how deep would the cutter stand in it, and how high must
// a link go. Units: mm, the block's tool frame. Invariant: heights only fall. Exactness: `cut` is
// exact at cell centres. The stock's own surface comes from PartStock's voxels between the exact
// bounds M and V_R, so it is half a voxel uncertain where other blocks have cut.
#pragma once

#include "planner/geometry/height_map.h"
#include "planner/machine/tool.h"
#include "planner/toolpath/part_stock.h"
#include "planner/toolpath/region.h"

namespace reforge {

// Solids that bound a block: V_R, M, and what holds the part (may be empty).
struct Surroundings {
  const TriangleMesh& initial;
  const TriangleMesh& reused;
  const TriangleMesh& fixture;
};

class BlockStock {
 public:
  BlockStock(const PartStock& stock, const Surroundings& solids, const Frame& frame,
             const Cutter& cutter);

  const HeightGrid& grid() const { return cut_.grid; }

  // The highest and the lowest rest still uncut over the block; empty when there is none.
  struct Span {
    double low, high;
    bool empty;
  };
  Span rest_span() const;
  // Whether rest deeper than `tolerance` stands above the height in the cell at (u, v).
  bool rest_above(double u, double v, double height) const;
  bool rest_above_cell(int column, int row, double height) const;

  // How far the ball's end, its tip at `tip`, would stand in rest; <= 0: clear.
  double rest_depth(const Vec3& tip) const;
  // The same in all that is not V_R. The skin next to V_R counts only under the middle of the ball:
  // beside a wall it is something the ball shaves with its side, not something that it stands in.
  double loose_depth(const Vec3& tip) const;
  // How far the ball would stand in anything that is not surely gone, V_R's walls and half a cell
  // of doubt included: <= 0 where a rapid may go.
  double touch_depth(const Vec3& tip) const;

  // The cutter passes straight from a to b (tips).
  void cut(const Vec3& a, const Vec3& b);

  // What stands there now, V_R and fixture included: no lower than anything above the cell.
  HeightMap standing() const;

  // Takes what was cut out of the part's stock; the voxels removed.
  BitSet commit(PartStock& stock) const;

 private:
  float rest_height(size_t cell) const;

  double ball_;
  HeightMap rest_top_, rest_bottom_;  // of the voxels that are to go
  HeightMap skin_top_;                // of the voxels next to V_R
  HeightMap whole_;                   // all stock at the start
  HeightMap floor_;                   // V_R and fixture
  HeightMap cut_;  // lowest surface the cutter has swept; +infinity where it was not
};

// Where the holder keeps the tip up, and how high links must go, given what stands.
class Clearance {
 public:
  Clearance(const HeightMap& standing, const Cutter& cutter);
  // Lowest tip at which everything wider than the ball clears what stands.
  double holder_floor(double u, double v) const { return look_up(holder_, u, v); }
  // Height at which the whole cutter may travel straight from a to b, and go straight up and down
  // at both.
  double link_height(const Vec2& a, const Vec2& b) const;

 private:
  static double look_up(const HeightMap& map, double u, double v);
  HeightMap holder_;
  HeightMap free_;
};

}  // namespace reforge

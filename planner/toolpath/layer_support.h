// Which part of each layer can be printed, and which part of it is filled wholly.
//
// Purpose: walk a block's slices upwards; a place is printable if what is below carries it (ground,
// or the printable part of the layer below, which it may overhang by kOverhang) and the nozzle
// comes there. Units: mm, the block's frame. Invariants: layers are asked for in ascending order;
// regions are exact where the whole layer is printable, else within half a node of the mask.
#pragma once

#include <deque>
#include <optional>

#include "planner/toolpath/deposition.h"
#include "planner/toolpath/plane_mask.h"
#include "planner/toolpath/slicing.h"

namespace reforge {

class LayerSupport {
 public:
  LayerSupport(const DepositionOptions& options, const TriangleMesh& block, const Frame& frame,
               const PrintSite& site);

  const Slices& slices() const { return slices_; }
  std::size_t layers() const { return slices_.layers.size(); }

  // The printable part of layer k. Forgets what lies far below.
  const PlaneRegion& printable(std::size_t k);
  // The part of it that shows within `solid_layers` above or below; all of it in layer 0.
  PlaneRegion solid(std::size_t k);

  // Height of what carried matter beneath the block at (u, v), or kEmpty.
  float ground_at(const Vec2& p) const;
  // Height at which the nozzle travels clear from a to b.
  double travel_height(const Vec2& a, const Vec2& b, double tip) const;

  double unsupported_mm3() const { return unsupported_mm3_; }
  double blocked_mm3() const { return blocked_mm3_; }

 private:
  struct Layer {
    PlaneRegion region;
    PlaneMask mask;     // of the region
    PlaneMask carried;  // what would be printable if the nozzle came everywhere
  };
  Layer next_layer(std::size_t k);
  const Layer* known(std::size_t k);
  PlaneMask ground_band(const PlaneMask& within, double tip) const;

  const DepositionOptions& options_;
  const Slices slices_;
  HeightMap ground_;        // what carries the block, at cell centres
  HeightMap standing_;      // what the nozzle must clear
  HeightMap nozzle_floor_;  // lowest tip there
  PlaneGrid grid_;
  std::deque<Layer> layers_;
  std::size_t first_ = 0;  // number of layers_.front()
  bool any_blocked_ = false;
  double unsupported_mm3_ = 0, blocked_mm3_ = 0;
};

}  // namespace reforge

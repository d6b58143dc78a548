// A solid cut into layers across its print direction.
//
// Purpose: the region of every layer, taken at half its height. Units: mm, the block's frame. Layer
// k lies between base + k h and base + (k + 1) h, where base is the solid's lowest point along the
// frame. Exactness: crossings are linked along the mesh's own edges, without tolerances, so a
// closed mesh gives closed rings.
#pragma once

#include "planner/geometry/height_map.h"
#include "planner/toolpath/region.h"

namespace reforge {

struct Slices {
  double base = 0;  // height of the lowest point
  double layer_height = 0;
  std::vector<PlaneRegion> layers;
  double top_of(size_t layer) const {
    return base + (static_cast<double>(layer) + 1) * layer_height;
  }
};

Slices slice(const TriangleMesh& solid, const Frame& frame, double layer_height_mm);

// The section of a solid at one height along the frame.
PlaneRegion section(const TriangleMesh& solid, const Frame& frame, double height);

}  // namespace reforge

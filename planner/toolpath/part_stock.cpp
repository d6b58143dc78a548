#include "planner/toolpath/part_stock.h"

#include <algorithm>
#include <cmath>

namespace reforge {

BitSet PartStock::rest() const {
  BitSet left = present;
  return left.subtract(keep);
}

PartStock part_stock(const TriangleMesh& initial, const TriangleMesh& reused, double voxels_max) {
  PartStock stock;
  const Box3 box = bounds(initial);
  const Vec3 size = box.sizes();
  const double pitch = std::clamp(std::cbrt(size.prod() / voxels_max), 0.25, 1.0);
  const VoxelGrid grid = VoxelGrid::over(box, pitch);
  stock.voxels = sample(initial, grid);
  const VoxelSet kept = sample(reused, grid);
  const size_t count = stock.voxels.size();
  stock.present = BitSet(count);
  stock.keep = BitSet(count);
  stock.near_keep = BitSet(count);
  for (size_t i = 0; i < count; ++i) {
    const auto [x, y, z] = stock.voxels.voxels[i];
    stock.present.set(i);
    if (kept.number(x, y, z) >= 0) {
      stock.keep.set(i);
      continue;
    }
    for (int n = 0; n < 27; ++n) {
      if (kept.number(x + n % 3 - 1, y + n / 3 % 3 - 1, z + n / 9 - 1) >= 0) {
        stock.near_keep.set(i);
        break;
      }
    }
  }
  return stock;
}

}  // namespace reforge

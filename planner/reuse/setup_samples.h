// Two parts as samples, for trying poses of the target by the thousand.
//
// Symbols: M initial, M* target; V~_R what both have in common; B the initial printing base, M's
//   surface inside M*.
// Units: mm. A pose leads from the target's file coordinates to the part frame; M stays where it is.
//
// Exactness: a share is a count of points of M* that lie in voxels of M. PoseSampler's is good for
// comparing poses: where surfaces coincide its shares are one or two per cent too low. What counts
// in the end is common_share().
#pragma once

#include <cstdint>
#include <vector>

#include "planner/geometry/mesh.h"
#include "planner/geometry/voxel_set.h"

namespace reforge {

struct Pose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Vec3 translation = Vec3::Zero();
};

// What Score_2 asks of a pose (paper.md, appendix D).
struct PoseBase {
  double area_mm2 = 0;   // Area(B)
  double lowest_z = 0;   // Min_B; without any base the same as highest_z
  double highest_z = 0;  // Max_V, of V~_R
};

// How much of M* lies in M, of M*, both where they stand.
struct CommonShare {
  double all = 0;       // V~_R / M*
  double standing = 0;  // of that, what stands on z = 0
};

// By one fine grid for both, so that surfaces that coincide agree; error below half a per cent.
CommonShare common_share(const TriangleMesh& initial, const TriangleMesh& target);

class PoseSampler {
 public:
  PoseSampler(const TriangleMesh& initial, const TriangleMesh& target_in_file);

  // V~_R / M* by every eighth sample, for looking around.
  double rough_share(const Pose& pose) const { return share_of(rough_, pose); }
  // The same by all samples.
  double share(const Pose& pose) const { return share_of(fine_, pose); }
  PoseBase base(const Pose& pose) const;

 private:
  struct Cells {
    VoxelGrid grid;
    std::vector<std::uint8_t> is_inside;
    bool at(const Vec3& cell) const {  // in units of the grid, rounded down
      const Eigen::Array3i index = cell.array().floor().cast<int>();
      if ((index < 0).any() || index[0] >= grid.size[0] || index[1] >= grid.size[1] ||
          index[2] >= grid.size[2]) {
        return false;
      }
      return is_inside[(static_cast<std::size_t>(index[2]) * grid.size[1] + index[1]) *
                           grid.size[0] +
                       index[0]] != 0;
    }
  };
  static Cells cells_of(const TriangleMesh& solid);
  double share_of(const std::vector<Vec3>& points, const Pose& pose) const;

  Cells initial_, target_;          // in the part frame; in the file's coordinates
  std::vector<Vec3> fine_, rough_;  // of M*, in the file's coordinates
  std::vector<Vec3> surface_;       // points of M's surface, one for each
  double surface_mm2_ = 0;          //   of these areas
};

}  // namespace reforge

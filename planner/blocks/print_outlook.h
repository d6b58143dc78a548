// From which directions which parts of V_A can be printed, by sample points.
//
// Purpose: quick answers while V_A is taken apart into blocks. Units: mm, part frame.
// A sample is *printable* along a direction if the nozzle with its tip there clears the obstacles,
// and matter of the target lies beneath it within 50 degrees of the direction (paper, section 6:
// self-supporting). Limits: samples stand kPitch apart; matter beneath counts whether or not it is
// printed earlier.
#pragma once

#include <vector>

#include "planner/geometry/bit_set.h"
#include "planner/geometry/plane.h"
#include "planner/geometry/voxel_set.h"
#include "planner/machine/tool.h"

namespace reforge {

class PrintOutlook {
 public:
  PrintOutlook(const TriangleMesh& target, const std::vector<const TriangleMesh*>& obstacles,
               const Nozzle& nozzle, std::vector<Vec3> directions);

  const std::vector<Vec3>& directions() const { return directions_; }
  // The direction's number; it is added when it is new.
  size_t number_of(const Vec3& direction);

  // Samples of a solid: numbers of points.
  std::vector<int> samples_in(const TriangleMesh& solid) const;
  const Vec3& point(int sample) const { return voxels_.points[static_cast<size_t>(sample)]; }
  bool printable(int sample, size_t direction) const {
    return printable_[direction].test(static_cast<size_t>(sample));
  }
  double mm3_per_sample() const { return voxels_.voxel_volume(); }

  // The plane across another direction beyond which printing along that direction, instead of
  // `along`, makes most additional samples printable; `gain` is their number.
  struct Split {
    Plane plane;
    size_t direction = 0;
    int gain = 0;
  };
  Split best_split(const std::vector<int>& samples, size_t along) const;

 private:
  BitSet printable_along(const Vec3& direction) const;

  VoxelSet voxels_;  // of the target
  std::vector<const TriangleMesh*> obstacles_;
  Nozzle nozzle_;
  std::vector<Vec3> directions_;
  std::vector<BitSet> printable_;
};

}  // namespace reforge

// The surface that milling must make: where V_R was uncovered by taking V_S away.
//
// Purpose: sample points of that surface, ticked off as finishing passes them. Units: mm, part
// frame. Invariant: a sample lies on V_R; a point `kProbe` outside it along its normal lies in V_S.
// Limits: places where V_S is thinner than kProbe are not seen (they are within tolerance already).
#pragma once

#include "planner/geometry/mesh.h"

namespace reforge {

struct MachinedSample {
  Vec3 point;
  Vec3 normal;  // out of V_R
};

// About one sample each `spacing_mm`.
std::vector<MachinedSample> machined_surface(const TriangleMesh& reused,
                                             const TriangleMesh& removed, double spacing_mm);

// Nearest samples by buckets.
class SampleIndex {
 public:
  SampleIndex(const std::vector<MachinedSample>& samples, double reach_mm);
  // Calls visit(sample number) for every sample within reach of the point whose normal is within 60
  // degrees.
  template <typename Visit>
  void near(const Vec3& point, const Vec3& normal, const Visit& visit) const {
    for (int n = 0; n < 27; ++n) {
      const size_t b =
          bucket(cell_of(point) + Eigen::Vector3i(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1));
      if (b == kOutside) continue;
      for (int i = start_[b]; i < start_[b + 1]; ++i) {
        const MachinedSample& s = (*samples_)[order_[i]];
        if ((s.point - point).squaredNorm() <= reach_ * reach_ && s.normal.dot(normal) > 0.5) {
          visit(order_[i]);
        }
      }
    }
  }

 private:
  static constexpr size_t kOutside = static_cast<size_t>(-1);
  Eigen::Vector3i cell_of(const Vec3& point) const;
  size_t bucket(const Eigen::Vector3i& cell) const;

  const std::vector<MachinedSample>* samples_;
  double reach_;
  Vec3 origin_ = Vec3::Zero();
  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();
  std::vector<int> start_;
  std::vector<int> order_;
};

}  // namespace reforge

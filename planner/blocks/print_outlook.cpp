#include "planner/blocks/print_outlook.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "planner/geometry/height_map.h"

namespace reforge {
namespace {

constexpr double kPitch = 0.8;
constexpr double kSteepestOverhang = 1.19;  // tan 50 degrees
constexpr int kAround = 8;
constexpr double kTipTolerance = 0.1;  // mm a tip may be lower than its map says

double widest(const Nozzle& nozzle) {
  double radius = 0;
  for (const ToolSection& s : nozzle.body) {
    for (const double r : {s.r_from_mm, s.r_to_mm}) {
      if (std::isfinite(r)) radius = std::max(radius, r);
    }
  }
  return radius;
}

}  // namespace

PrintOutlook::PrintOutlook(const TriangleMesh& target,
                           const std::vector<const TriangleMesh*>& obstacles, const Nozzle& nozzle,
                           std::vector<Vec3> directions)
    : voxels_(sample(target, VoxelGrid::over(bounds(target), kPitch))),
      obstacles_(obstacles),
      nozzle_(nozzle) {
  for (const Vec3& d : directions) number_of(d);
}

size_t PrintOutlook::number_of(const Vec3& direction) {
  for (size_t k = 0; k < directions_.size(); ++k) {
    if (directions_[k].dot(direction) > 1 - 1e-9) return k;
  }
  directions_.push_back(direction);
  printable_.push_back(printable_along(direction));
  return directions_.size() - 1;
}

std::vector<int> PrintOutlook::samples_in(const TriangleMesh& solid) const {
  std::vector<int> samples;
  const VoxelSet inside = sample(solid, voxels_.grid);
  for (const auto& [i, j, k] : inside.voxels) {
    const std::int32_t n = voxels_.number(i, j, k);
    if (n >= 0) samples.push_back(n);
  }
  return samples;
}

BitSet PrintOutlook::printable_along(const Vec3& d) const {
  const Frame frame = Frame::along(d);
  HeightMap standing(
      HeightGrid::over(frame, kPitch / 2, voxels_.points, widest(nozzle_) + 2 * kPitch));
  double highest = HeightMap::kEmpty;
  for (const TriangleMesh* obstacle : obstacles_) {
    raise_to(standing, *obstacle, Sampling::kCentres);
    for (const Vec3& v : obstacle->vertices) highest = std::max(highest, d.dot(v));
  }
  HeightMap floor = tip_heights(standing, nozzle_.body);
  for (const ToolSection& section : nozzle_.body) {
    if (std::isfinite(section.r_from_mm)) continue;
    const auto limit = static_cast<float>(highest - section.z_from_mm);
    for (float& height : floor.heights) height = std::max(height, limit);
  }
  std::vector<Vec3> beneath{-kPitch * d};
  for (int k = 0; k < kAround; ++k) {
    const double angle = 2 * std::numbers::pi * k / kAround;
    const Vec3 aside = std::cos(angle) * frame.u + std::sin(angle) * frame.v;
    beneath.push_back(kPitch * (kSteepestOverhang * aside - d));
  }
  BitSet printable(voxels_.size());
  for (size_t i = 0; i < voxels_.size(); ++i) {
    const Vec3& p = voxels_.points[i];
    if (floor.lookup(p) > d.dot(p) + kTipTolerance) continue;
    const bool carried = std::any_of(beneath.begin(), beneath.end(), [&](const Vec3& step) {
      return voxels_.number_at(p + step) >= 0;
    });
    if (carried) printable.set(i);
  }
  return printable;
}

PrintOutlook::Split PrintOutlook::best_split(const std::vector<int>& samples, size_t along) const {
  Split best;
  for (size_t k = 0; k < directions_.size(); ++k) {
    if (k == along) continue;
    const Vec3& d = directions_[k];
    std::vector<std::pair<double, int>> by_height;
    for (const int s : samples) {
      by_height.emplace_back(d.dot(point(s)),
                             static_cast<int>(printable(s, k)) - printable(s, along));
    }
    std::sort(by_height.begin(), by_height.end());
    // From the top down: what is gained by printing everything from here up along k.
    int gain = 0;
    for (size_t i = by_height.size(); i-- > 1;) {
      gain += by_height[i].second;
      const double between = (by_height[i].first + by_height[i - 1].first) / 2;
      if (gain > best.gain && by_height[i].first - by_height[i - 1].first > 1e-9) {
        best = {{d, between}, k, gain};
      }
    }
  }
  return best;
}

}  // namespace reforge

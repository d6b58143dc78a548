#include "planner/reuse/surface_samples.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <unordered_map>

namespace reforge {
namespace {

constexpr double kOnBase = 1e-3;  // mm

// V~_R, whether it stays or goes.
bool is_matter(std::uint8_t region) {
  return region == kReused || region == kThenAdded;
}

// Hands out points of a set of triangles, uniform by area.
class AreaSampler {
 public:
  AreaSampler(const CellComplex& complex, std::vector<std::uint32_t> facets)
      : complex_(complex), facets_(std::move(facets)) {
    double sum = 0;
    for (const auto f : facets_) {
      const auto& [a, b, c] = complex.facets[f].corners;
      const auto& v = complex.vertices;
      sum += (v[b] - v[a]).cross(v[c] - v[a]).norm() / 2;
      up_to_.push_back(sum);
    }
  }
  double area() const { return up_to_.empty() ? 0 : up_to_.back(); }

  std::pair<std::uint32_t, Vec3> draw(std::mt19937_64& random) const {
    const double at = unit(random) * area();
    const auto entry = std::upper_bound(up_to_.begin(), up_to_.end() - 1, at);
    const auto f = facets_[static_cast<std::size_t>(entry - up_to_.begin())];
    const auto& [a, b, c] = complex_.facets[f].corners;
    const double root = std::sqrt(unit(random)), along = unit(random);
    const auto& v = complex_.vertices;
    return {f, (1 - root) * v[a] + root * (1 - along) * v[b] + root * along * v[c]};
  }

 private:
  // Not std::uniform_real_distribution: its numbers differ between libraries.
  static double unit(std::mt19937_64& random) {
    return static_cast<double>(random() >> 11) * 0x1p-53;
  }

  const CellComplex& complex_;
  std::vector<std::uint32_t> facets_;
  std::vector<double> up_to_;
};

// Accepts points that keep their distance from all accepted before.
class Spacing {
 public:
  explicit Spacing(double distance) : distance_(distance) {}
  bool accept(const Vec3& point) {
    const Eigen::Array3i cell = (point / distance_).array().floor().cast<int>();
    for (int n = 0; n < 27; ++n) {
      const auto bucket =
          cells_.find(key(cell + Eigen::Array3i(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1)));
      if (bucket == cells_.end()) continue;
      for (const Vec3& other : bucket->second) {
        if ((other - point).norm() < distance_) return false;
      }
    }
    cells_[key(cell)].push_back(point);
    return true;
  }

 private:
  static std::uint64_t key(const Eigen::Array3i& cell) {
    const auto part = [&](int k) { return static_cast<std::uint64_t>(cell[k] + (1 << 20)); };
    return part(0) << 42 | part(1) << 21 | part(2);
  }
  double distance_;
  std::unordered_map<std::uint64_t, std::vector<Vec3>> cells_;
};

}  // namespace

std::vector<SurfaceSample> sample_borders(const CellComplex& complex,
                                          const std::vector<bool>& is_skin, double distance_mm,
                                          std::uint64_t seed) {
  std::map<std::pair<std::uint8_t, std::uint8_t>, std::vector<std::uint32_t>> borders;
  for (std::uint32_t f = 0; f < complex.facets.size(); ++f) {
    auto [corners, front, back, origin, mark] = complex.facets[f];
    if (mark == 0 && is_skin[origin]) {
      const auto matter = is_matter(front) ? front : back;
      if (!is_matter(matter)) continue;
      (matter == front ? back : front) = kOutside;
    }
    double highest = 0;
    for (const auto corner : corners) highest = std::max(highest, complex.vertices[corner].z());
    if (highest < kOnBase) continue;
    borders[{std::min(front, back), std::max(front, back)}].push_back(f);
  }
  std::vector<SurfaceSample> samples;
  for (const auto& [regions, facets] : borders) {
    const AreaSampler sampler(complex, facets);
    std::mt19937_64 random(seed * 1000003 + regions.first * 32u + regions.second);
    Spacing spacing(distance_mm);
    // Ten darts for each place fill all but a few gaps.
    const auto darts =
        10 + static_cast<std::size_t>(10 * sampler.area() / (distance_mm * distance_mm));
    for (std::size_t dart = 0; dart < darts; ++dart) {
      const auto [f, position] = sampler.draw(random);
      if (!spacing.accept(position)) continue;
      const CellFacet& facet = complex.facets[f];
      const auto& v = complex.vertices;
      Vec3 normal = (v[facet.corners[1]] - v[facet.corners[0]])
                        .cross(v[facet.corners[2]] - v[facet.corners[0]])
                        .normalized();
      auto matter = static_cast<Region>(facet.back), other = static_cast<Region>(facet.front);
      if (other == kReused || matter == kOutside || (other == kThenAdded && matter != kReused)) {
        std::swap(matter, other);
        normal = -normal;
      }
      if (facet.mark == 0 && is_skin[facet.origin]) other = kOutside;
      samples.push_back({position, normal, matter, other, f, facet.origin});
    }
  }
  return samples;
}

}  // namespace reforge

#include "planner/toolpath/machined_surface.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

namespace reforge {
namespace {

constexpr double kProbe = 0.02;  // mm outside V_R where V_S must be

// Inside a solid by counting what a ray straight up crosses.
class Inside {
 public:
  explicit Inside(const TriangleMesh& solid) : solid_(solid), box_(bounds(solid)) {
    if (solid.empty()) return;
    const Vec3 size = box_.sizes();
    cell_ = std::max(0.5, std::sqrt(size.x() * size.y() / 40000));
    columns_ = static_cast<int>(size.x() / cell_) + 1;
    rows_ = static_cast<int>(size.y() / cell_) + 1;
    buckets_.resize(static_cast<size_t>(columns_) * rows_);
    for (int t = 0; t < static_cast<int>(solid.triangles.size()); ++t) {
      Box3 flat;
      for (const auto corner : solid.triangles[t]) flat.extend(solid.vertices[corner]);
      const auto [c0, r0] = at(flat.min());
      const auto [c1, r1] = at(flat.max());
      for (int r = r0; r <= r1; ++r) {
        for (int c = c0; c <= c1; ++c) buckets_[static_cast<size_t>(r) * columns_ + c].push_back(t);
      }
    }
  }

  bool operator()(const Vec3& p) const {
    if (solid_.empty() || !box_.contains(p)) return false;
    const auto [c, r] = at(p);
    int winding = 0;
    for (const int t : buckets_[static_cast<size_t>(r) * columns_ + c]) winding += crossing(t, p);
    return winding != 0;
  }

 private:
  std::pair<int, int> at(const Vec3& p) const {
    const Vec3 d = (p - box_.min()) / cell_;
    return {std::clamp(static_cast<int>(d.x()), 0, columns_ - 1),
            std::clamp(static_cast<int>(d.y()), 0, rows_ - 1)};
  }

  // +1 / -1 when the ray from p straight up passes triangle t; edges belong to one of their two
  // sides.
  int crossing(int t, const Vec3& p) const {
    const auto& tri = solid_.triangles[t];
    int sign = 0;
    for (int i = 0; i < 3; ++i) {
      Vec3 a = solid_.vertices[tri[i]], b = solid_.vertices[tri[(i + 1) % 3]];
      // One orientation for an edge, whichever triangle asks.
      const bool swapped = std::tie(b.x(), b.y(), b.z()) < std::tie(a.x(), a.y(), a.z());
      if (swapped) std::swap(a, b);
      const double side = (b.x() - a.x()) * (p.y() - a.y()) - (b.y() - a.y()) * (p.x() - a.x());
      const int s = (side >= 0 ? 1 : -1) * (swapped ? -1 : 1);
      if (i == 0) {
        sign = s;
      } else if (s != sign) {
        return 0;
      }
    }
    const Vec3 &a = solid_.vertices[tri[0]], &b = solid_.vertices[tri[1]],
               &c = solid_.vertices[tri[2]];
    const Vec3 n = (b - a).cross(c - a);
    if (n.z() == 0) return 0;
    const double z = a.z() - (n.x() * (p.x() - a.x()) + n.y() * (p.y() - a.y())) / n.z();
    return z > p.z() ? sign : 0;
  }

  const TriangleMesh& solid_;
  Box3 box_;
  double cell_ = 1;
  int columns_ = 1, rows_ = 1;
  std::vector<std::vector<int>> buckets_;
};

}  // namespace

std::vector<MachinedSample> machined_surface(const TriangleMesh& reused,
                                             const TriangleMesh& removed, double spacing_mm) {
  std::vector<MachinedSample> samples;
  if (removed.empty()) return samples;
  const Inside in_removed(removed);
  // Fine meshes would give many samples to a place: one for each small cube and main direction.
  std::set<std::tuple<long, long, long, int>> taken;
  const double cube = spacing_mm * 0.6;
  for (const auto& tri : reused.triangles) {
    const Vec3 &a = reused.vertices[tri[0]], &b = reused.vertices[tri[1]],
               &c = reused.vertices[tri[2]];
    const Vec3 cross = (b - a).cross(c - a);
    if (cross.norm() < 1e-9) continue;
    const Vec3 normal = cross.normalized();
    int main = 0;
    normal.cwiseAbs().maxCoeff(&main);
    main = 2 * main + (normal[main] > 0);
    const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
    const int n = std::max(1, static_cast<int>(std::ceil(longest / spacing_mm)));
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n - i; ++j) {
        // Centres of the upright small triangles of an n-fold subdivision.
        const Vec3 p = a + (b - a) * ((i + 1.0 / 3) / n) + (c - a) * ((j + 1.0 / 3) / n);
        if (!in_removed(p + kProbe * normal)) continue;
        const auto key = std::make_tuple(std::lround(p.x() / cube), std::lround(p.y() / cube),
                                         std::lround(p.z() / cube), main);
        if (taken.insert(key).second) samples.push_back({p, normal});
      }
    }
  }
  return samples;
}

SampleIndex::SampleIndex(const std::vector<MachinedSample>& samples, double reach_mm)
    : samples_(&samples), reach_(reach_mm) {
  if (samples.empty()) return;
  Box3 box;
  for (const MachinedSample& s : samples) box.extend(s.point);
  origin_ = box.min();
  for (int k = 0; k < 3; ++k) size_[k] = static_cast<int>(box.sizes()[k] / reach_) + 1;
  start_.assign(static_cast<size_t>(size_[0]) * size_[1] * size_[2] + 1, 0);
  for (const MachinedSample& s : samples) ++start_[bucket(cell_of(s.point)) + 1];
  for (size_t b = 1; b < start_.size(); ++b) start_[b] += start_[b - 1];
  order_.resize(samples.size());
  std::vector<int> at(start_);
  for (int i = 0; i < static_cast<int>(samples.size()); ++i)
    order_[at[bucket(cell_of(samples[i].point))]++] = i;
}

Eigen::Vector3i SampleIndex::cell_of(const Vec3& point) const {
  Eigen::Vector3i cell;
  for (int k = 0; k < 3; ++k) {
    // Far away is as good as just outside, and fits an int.
    cell[k] = static_cast<int>(
        std::clamp(std::floor((point[k] - origin_[k]) / reach_), -2.0, size_[k] + 1.0));
  }
  return cell;
}

size_t SampleIndex::bucket(const Eigen::Vector3i& cell) const {
  size_t index = 0;
  for (int k = 2; k >= 0; --k) {
    if (cell[k] < 0 || cell[k] >= size_[k]) return kOutside;
    index = index * size_[k] + static_cast<size_t>(cell[k]);
  }
  return index;
}

}  // namespace reforge

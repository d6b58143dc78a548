#include "planner/toolpath/offset_surface.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace reforge {
namespace {

// Facets that face away from the tool by more than this cannot carry the ball: their edges and
// corners belong to facets that face it.
constexpr double kFacesAway = -1e-6;

struct Resting {
  double centre;
  Vec3 touch;
};

// The contact on the facet's inside, if the ball rests there.
bool rest_on_face(const std::array<Vec3, 3>& t, const Vec3& n, double radius, double u, double v,
                  Resting& out) {
  if (n.z() < 1e-9) return false;
  const double centre = (n.dot(t[0]) + radius - n.x() * u - n.y() * v) / n.z();
  const double x = u - radius * n.x(), y = v - radius * n.y();
  for (int i = 0; i < 3; ++i) {
    const Vec3 &a = t[i], &b = t[(i + 1) % 3];
    if ((b.x() - a.x()) * (y - a.y()) - (b.y() - a.y()) * (x - a.x()) < 0) return false;
  }
  out = {centre, Vec3(x, y, centre - radius * n.z())};
  return true;
}

bool rest_on_edge(const Vec3& a, const Vec3& b, double radius, double u, double v, Resting& out) {
  const double hx = b.x() - a.x(), hy = b.y() - a.y();
  const double run = std::hypot(hx, hy);
  if (run < 1e-12) return false;  // upright: its upper corner carries the ball
  const double px = u - a.x(), py = v - a.y();
  const double aside = (hx * py - hy * px) / run;
  if (std::abs(aside) >= radius) return false;
  // In the upright plane through the edge the ball is a circle that rests on a sloping line.
  const double circle = std::sqrt(radius * radius - aside * aside);
  const double along = (px * hx + py * hy) / run;
  const double slope = (b.z() - a.z()) / run;
  const double secant = std::sqrt(1 + slope * slope);
  const double touch = along + circle * slope / secant;
  if (touch < 0 || touch > run) return false;
  const double t = touch / run;
  out = {a.z() + slope * along + circle * secant, a + t * (b - a)};
  return true;
}

bool rest_on_corner(const Vec3& a, double radius, double u, double v, Resting& out) {
  const double d2 = (u - a.x()) * (u - a.x()) + (v - a.y()) * (v - a.y());
  if (d2 >= radius * radius) return false;
  out = {a.z() + std::sqrt(radius * radius - d2), a};
  return true;
}

}  // namespace

OffsetSurface::OffsetSurface(const TriangleMesh& solid, const Frame& frame, double radius_mm)
    : radius_(radius_mm) {
  assert(radius_mm > 0);
  double lo[2] = {1e300, 1e300}, hi[2] = {-1e300, -1e300};
  for (int t = 0; t < static_cast<int>(solid.triangles.size()); ++t) {
    Facet f;
    for (int i = 0; i < 3; ++i) f.corner[i] = frame.to_local(solid.vertices[solid.triangles[t][i]]);
    const Vec3 cross = (f.corner[1] - f.corner[0]).cross(f.corner[2] - f.corner[0]);
    const double size = cross.norm();
    f.normal = size > 0 ? Vec3(cross / size) : Vec3::Zero();
    if (size > 0 && f.normal.z() < kFacesAway) continue;
    f.top = std::max({f.corner[0].z(), f.corner[1].z(), f.corner[2].z()});
    f.triangle = t;
    for (const Vec3& c : f.corner) {
      for (int k = 0; k < 2; ++k) {
        lo[k] = std::min(lo[k], c[k]);
        hi[k] = std::max(hi[k], c[k]);
      }
    }
    facets_.push_back(f);
  }
  if (facets_.empty()) return;
  std::stable_sort(facets_.begin(), facets_.end(),
                   [](const Facet& a, const Facet& b) { return a.top > b.top; });
  u0_ = lo[0] - radius_;
  v0_ = lo[1] - radius_;
  const double width = hi[0] - lo[0] + 2 * radius_, height = hi[1] - lo[1] + 2 * radius_;
  cell_ = std::max(radius_ / 2, std::sqrt(width * height / 250000));
  columns_ = static_cast<int>(width / cell_) + 1;
  rows_ = static_cast<int>(height / cell_) + 1;
  // Two passes over the facets: count, then fill; a bucket keeps the order, highest first.
  bucket_start_.assign(static_cast<size_t>(columns_) * rows_ + 1, 0);
  for (const bool fill : {false, true}) {
    std::vector<int> at(fill ? bucket_start_ : std::vector<int>{});
    for (int i = 0; i < static_cast<int>(facets_.size()); ++i) {
      const auto& c = facets_[i].corner;
      const auto first = [&](int k, double origin) {
        return static_cast<int>((std::min({c[0][k], c[1][k], c[2][k]}) - radius_ - origin) / cell_);
      };
      const auto last = [&](int k, double origin, int count) {
        const double top = std::max({c[0][k], c[1][k], c[2][k]}) + radius_ - origin;
        return std::min(count - 1, static_cast<int>(top / cell_));
      };
      for (int row = std::max(0, first(1, v0_)); row <= last(1, v0_, rows_); ++row) {
        for (int col = std::max(0, first(0, u0_)); col <= last(0, u0_, columns_); ++col) {
          const size_t bucket = static_cast<size_t>(row) * columns_ + col;
          if (fill) {
            bucket_facets_[at[bucket]++] = i;
          } else {
            ++bucket_start_[bucket + 1];
          }
        }
      }
    }
    if (!fill) {
      for (size_t b = 1; b < bucket_start_.size(); ++b) bucket_start_[b] += bucket_start_[b - 1];
      bucket_facets_.resize(bucket_start_.back());
    }
  }
}

void OffsetSurface::rest_on(const Facet& f, double u, double v, Contact& best) const {
  Resting resting;
  const auto take = [&] {
    if (resting.centre <= best.centre) return;
    best = {resting.centre, f.triangle, (Vec3(u, v, resting.centre) - resting.touch) / radius_};
  };
  if (rest_on_face(f.corner, f.normal, radius_, u, v, resting)) return take();
  for (int i = 0; i < 3; ++i) {
    if (rest_on_edge(f.corner[i], f.corner[(i + 1) % 3], radius_, u, v, resting)) take();
    if (rest_on_corner(f.corner[i], radius_, u, v, resting)) take();
  }
}

OffsetSurface::Contact OffsetSurface::contact(double u, double v) const {
  Contact best;
  const int col = static_cast<int>(std::floor((u - u0_) / cell_));
  const int row = static_cast<int>(std::floor((v - v0_) / cell_));
  if (col < 0 || row < 0 || col >= columns_ || row >= rows_) return best;
  const size_t bucket = static_cast<size_t>(row) * columns_ + col;
  for (int k = bucket_start_[bucket]; k < bucket_start_[bucket + 1]; ++k) {
    const Facet& facet = facets_[bucket_facets_[k]];
    if (facet.top + radius_ <= best.centre) break;
    rest_on(facet, u, v, best);
  }
  return best;
}

}  // namespace reforge

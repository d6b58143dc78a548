#include "planner/toolpath/offset_surface.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <tuple>

namespace reforge {
namespace {

// Faces that look away from the tool by more than this cannot carry the ball.
constexpr double kLooksAway = -1e-6;
constexpr int kBucketsMax = 250000;

struct HalfEdge {
  std::uint32_t low, high;  // corners by number
  int face;
};

}  // namespace

OffsetSurface::OffsetSurface(const TriangleMesh& solid, const Frame& frame, double radius_mm)
    : radius_(radius_mm) {
  assert(radius_mm > 0);
  collect(solid, frame);
  if (!carriers_.empty()) sort_into_buckets();
}

void OffsetSurface::collect(const TriangleMesh& solid, const Frame& frame) {
  std::vector<Vec3> at;
  at.reserve(solid.vertices.size());
  for (const Vec3& vertex : solid.vertices) at.push_back(frame.to_local(vertex));
  std::vector<Vec3> normals;
  std::vector<HalfEdge> halves;
  for (int t = 0; t < static_cast<int>(solid.triangles.size()); ++t) {
    const auto& tri = solid.triangles[t];
    const Vec3 cross = (at[tri[1]] - at[tri[0]]).cross(at[tri[2]] - at[tri[0]]);
    const double size = cross.norm();
    normals.push_back(size > 0 ? Vec3(cross / size) : Vec3(Vec3::Zero()));
    for (int i = 0; i < 3; ++i) {
      const auto [low, high] = std::minmax(tri[i], tri[(i + 1) % 3]);
      halves.push_back({low, high, t});
    }
    if (normals[t].z() > 1e-9) {
      const Face face{{at[tri[0]], at[tri[1]], at[tri[2]]}, normals[t]};
      const double top = std::max({face.corner[0].z(), face.corner[1].z(), face.corner[2].z()});
      carriers_.push_back({Carrier::Kind::kFace, static_cast<int>(faces_.size()), top});
      faces_.push_back(face);
    }
  }
  std::stable_sort(halves.begin(), halves.end(), [](const HalfEdge& a, const HalfEdge& b) {
    return std::tie(a.low, a.high) < std::tie(b.low, b.high);
  });
  std::vector<char> carries(at.size(), 0);
  for (size_t i = 0; i < halves.size();) {
    size_t end = i + 1;
    while (end < halves.size() && halves[end].low == halves[i].low &&
           halves[end].high == halves[i].high) {
      ++end;
    }
    const Vec3 &a = at[halves[i].low], &b = at[halves[i].high];
    bool looks_up = false;
    for (size_t k = i; k < end; ++k) looks_up |= normals[halves[k].face].z() > kLooksAway;
    // Convex: the far corner of one face lies below the plane of the other.
    bool convex = end - i != 2;
    if (!convex) {
      const auto& other = solid.triangles[halves[i + 1].face];
      for (const auto corner : other) {
        if (corner == halves[i].low || corner == halves[i].high) continue;
        convex = normals[halves[i].face].dot(at[corner] - a) < 1e-12;
      }
    }
    if (looks_up && convex) {
      carries[halves[i].low] = carries[halves[i].high] = 1;
      Edge edge{a, b, b.x() - a.x(), b.y() - a.y(), 0, 0, 0};
      edge.run = std::hypot(edge.along_x, edge.along_y);
      if (edge.run > 1e-12) {  // else upright: its upper corner carries the ball
        edge.along_x /= edge.run;
        edge.along_y /= edge.run;
        edge.slope = (b.z() - a.z()) / edge.run;
        edge.secant = std::sqrt(1 + edge.slope * edge.slope);
        const double top = std::max(a.z(), b.z());
        carriers_.push_back({Carrier::Kind::kEdge, static_cast<int>(edges_.size()), top});
        edges_.push_back(edge);
      }
    }
    i = end;
  }
  for (size_t v = 0; v < at.size(); ++v) {
    if (!carries[v]) continue;
    carriers_.push_back({Carrier::Kind::kCorner, static_cast<int>(corners_.size()), at[v].z()});
    corners_.push_back(at[v]);
  }
  std::stable_sort(carriers_.begin(), carriers_.end(),
                   [](const Carrier& a, const Carrier& b) { return a.top > b.top; });
}

void OffsetSurface::sort_into_buckets() {
  std::vector<std::array<double, 4>> boxes;  // u low, high, v low, high, grown by the radius
  double low_u = 1e300, high_u = -1e300, low_v = 1e300, high_v = -1e300;
  for (const Carrier& c : carriers_) {
    std::array<double, 4> box{1e300, -1e300, 1e300, -1e300};
    const auto take = [&](const Vec3& p) {
      box = {std::min(box[0], p.x() - radius_), std::max(box[1], p.x() + radius_),
             std::min(box[2], p.y() - radius_), std::max(box[3], p.y() + radius_)};
    };
    if (c.kind == Carrier::Kind::kFace) {
      for (const Vec3& p : faces_[c.index].corner) take(p);
    } else if (c.kind == Carrier::Kind::kEdge) {
      take(edges_[c.index].from);
      take(edges_[c.index].to);
    } else {
      take(corners_[c.index]);
    }
    low_u = std::min(low_u, box[0]);
    high_u = std::max(high_u, box[1]);
    low_v = std::min(low_v, box[2]);
    high_v = std::max(high_v, box[3]);
    boxes.push_back(box);
  }
  u0_ = low_u;
  v0_ = low_v;
  const double width = high_u - low_u, height = high_v - low_v;
  cell_ = std::max(radius_ / 3, std::sqrt(width * height / kBucketsMax));
  columns_ = static_cast<int>(width / cell_) + 1;
  rows_ = static_cast<int>(height / cell_) + 1;
  bucket_start_.assign(static_cast<size_t>(columns_) * rows_ + 1, 0);
  const auto cell = [&](double x, double origin, int count) {
    return std::clamp(static_cast<int>((x - origin) / cell_), 0, count - 1);
  };
  // Two passes: count, then fill; a bucket keeps the order, highest first.
  for (const bool fill : {false, true}) {
    std::vector<int> next(fill ? bucket_start_ : std::vector<int>{});
    for (int i = 0; i < static_cast<int>(carriers_.size()); ++i) {
      const auto& box = boxes[i];
      for (int row = cell(box[2], v0_, rows_); row <= cell(box[3], v0_, rows_); ++row) {
        for (int col = cell(box[0], u0_, columns_); col <= cell(box[1], u0_, columns_); ++col) {
          const size_t b = static_cast<size_t>(row) * columns_ + col;
          if (fill) {
            bucket_carriers_[next[b]++] = i;
          } else {
            ++bucket_start_[b + 1];
          }
        }
      }
    }
    if (fill) continue;
    for (size_t b = 1; b < bucket_start_.size(); ++b) bucket_start_[b] += bucket_start_[b - 1];
    bucket_carriers_.resize(bucket_start_.back());
  }
}

void OffsetSurface::rest_on_face(const Face& face, double u, double v, Contact& best) const {
  const Vec3& n = face.normal;
  const double centre = (n.dot(face.corner[0]) + radius_ - n.x() * u - n.y() * v) / n.z();
  if (centre <= best.centre) return;
  const double x = u - radius_ * n.x(), y = v - radius_ * n.y();
  for (int i = 0; i < 3; ++i) {
    const Vec3 &a = face.corner[i], &b = face.corner[(i + 1) % 3];
    if ((b.x() - a.x()) * (y - a.y()) - (b.y() - a.y()) * (x - a.x()) < 0) return;
  }
  best = {centre, n};
}

void OffsetSurface::rest_on_edge(const Edge& e, double u, double v, Contact& best) const {
  const double px = u - e.from.x(), py = v - e.from.y();
  const double aside = e.along_x * py - e.along_y * px;
  if (std::abs(aside) >= radius_) return;
  // In the upright plane through the edge the ball is a circle that rests on a sloping line.
  const double circle = std::sqrt(radius_ * radius_ - aside * aside);
  const double along = px * e.along_x + py * e.along_y;
  const double touch = along + circle * e.slope / e.secant;
  if (touch < 0 || touch > e.run) return;
  const double centre = e.from.z() + e.slope * along + circle * e.secant;
  if (centre <= best.centre) return;
  const Vec3 at = e.from + touch / e.run * (e.to - e.from);
  best = {centre, (Vec3(u, v, centre) - at) / radius_};
}

void OffsetSurface::rest_on_corner(const Vec3& a, double u, double v, Contact& best) const {
  const double d2 = (u - a.x()) * (u - a.x()) + (v - a.y()) * (v - a.y());
  if (d2 >= radius_ * radius_) return;
  const double centre = a.z() + std::sqrt(radius_ * radius_ - d2);
  if (centre > best.centre) best = {centre, (Vec3(u, v, centre) - a) / radius_};
}

void OffsetSurface::rest_on(const Carrier& carrier, double u, double v, Contact& best) const {
  switch (carrier.kind) {
    case Carrier::Kind::kFace:
      rest_on_face(faces_[carrier.index], u, v, best);
      return;
    case Carrier::Kind::kEdge:
      rest_on_edge(edges_[carrier.index], u, v, best);
      return;
    case Carrier::Kind::kCorner:
      rest_on_corner(corners_[carrier.index], u, v, best);
      return;
  }
}

std::pair<const int*, const int*> OffsetSurface::bucket(double u, double v) const {
  const double col = std::floor((u - u0_) / cell_), row = std::floor((v - v0_) / cell_);
  if (!(col >= 0 && row >= 0 && col < columns_ && row < rows_)) return {nullptr, nullptr};
  const size_t b = static_cast<size_t>(row) * columns_ + static_cast<size_t>(col);
  const int* first = bucket_carriers_.data();
  return {first + bucket_start_[b], first + bucket_start_[b + 1]};
}

OffsetSurface::Contact OffsetSurface::contact(double u, double v) const {
  Contact best;
  const auto [first, last] = bucket(u, v);
  for (const int* c = first; c != last; ++c) {
    if (carriers_[*c].top + radius_ <= best.centre) break;
    rest_on(carriers_[*c], u, v, best);
  }
  return best;
}

bool OffsetSurface::is_above(double u, double v, double height) const {
  Contact best;
  best.centre = height;
  const auto [first, last] = bucket(u, v);
  for (const int* c = first; c != last; ++c) {
    if (carriers_[*c].top + radius_ <= height) return false;
    rest_on(carriers_[*c], u, v, best);
    if (best.centre > height) return true;
  }
  return false;
}

}  // namespace reforge

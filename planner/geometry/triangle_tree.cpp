#include "planner/geometry/triangle_tree.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numeric>

#include "planner/geometry/mesh_topology.h"

namespace reforge {
namespace {

constexpr std::uint32_t kLeaf = 4;

Vec3 closest_on_segment(const Vec3& p, const Vec3& a, const Vec3& b) {
  const Vec3 along = b - a;
  const double length2 = along.squaredNorm();
  if (length2 == 0) return a;
  return a + std::clamp((p - a).dot(along) / length2, 0.0, 1.0) * along;
}

Vec3 closest_on_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 normal = (b - a).cross(c - a);
  const double norm2 = normal.squaredNorm();
  // Inside the prism over the triangle the foot of the perpendicular is closest.
  if (norm2 > 0 && (b - a).cross(p - a).dot(normal) >= 0 && (c - b).cross(p - b).dot(normal) >= 0 &&
      (a - c).cross(p - c).dot(normal) >= 0) {
    return p - (p - a).dot(normal) / norm2 * normal;
  }
  Vec3 best = closest_on_segment(p, a, b);
  for (const Vec3& candidate : {closest_on_segment(p, b, c), closest_on_segment(p, c, a)}) {
    if ((candidate - p).squaredNorm() < (best - p).squaredNorm()) best = candidate;
  }
  return best;
}

bool all_on_one_side(double x, double y, double z, double margin) {
  return (x > margin && y > margin && z > margin) || (x < -margin && y < -margin && z < -margin);
}

using Triangle = std::array<Vec3, 3>;

double determinant(const Vec3& a, const Vec3& b, const Vec3& c) {
  return a.dot(b.cross(c));
}

// Whether two triangles may share a point; says no only beyond doubt.
bool triangles_may_meet(const Triangle& s, const Triangle& t) {
  double size = 0;
  for (const Triangle* triangle : {&s, &t}) {
    for (const Vec3& p : *triangle) size = std::max(size, (p - s[0]).cwiseAbs().maxCoeff());
  }
  const double doubt = 1e-13 * size * size * size;  // far above the rounding of a determinant
  for (const auto& [one, other] : {std::pair(&s, &t), std::pair(&t, &s)}) {
    const auto& [a, b, c] = *one;
    const Vec3 normal = (b - a).cross(c - a);
    if (all_on_one_side(((*other)[0] - a).dot(normal), ((*other)[1] - a).dot(normal),
                        ((*other)[2] - a).dot(normal), doubt)) {
      return false;
    }
  }
  // If they meet, an edge of one goes through the other.
  for (const auto& [one, other] : {std::pair(&s, &t), std::pair(&t, &s)}) {
    const auto& [a, b, c] = *one;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 &p = (*other)[k], &q = (*other)[(k + 1) % 3];
      const double from = determinant(b - a, c - a, p - a), to = determinant(b - a, c - a, q - a);
      if ((from > doubt && to > doubt) || (from < -doubt && to < -doubt)) continue;
      const double u = determinant(q - p, a - p, b - p), v = determinant(q - p, b - p, c - p),
                   w = determinant(q - p, c - p, a - p);
      const bool above = u > doubt || v > doubt || w > doubt;
      const bool below = u < -doubt || v < -doubt || w < -doubt;
      if (!(above && below)) return true;
    }
  }
  return false;
}

}  // namespace

TriangleTree::TriangleTree(const TriangleMesh& mesh) : mesh_(&mesh) {
  const auto count = static_cast<std::uint32_t>(mesh.triangles.size());
  order_.resize(count);
  std::iota(order_.begin(), order_.end(), 0u);
  std::vector<Vec3> centres(count);
  normals_.resize(count);
  for (std::uint32_t t = 0; t < count; ++t) {
    const Vec3 &a = corner(t, 0), &b = corner(t, 1), &c = corner(t, 2);
    centres[t] = (a + b + c) / 3;
    const Vec3 cross = (b - a).cross(c - a);
    const double longest =
        std::sqrt(std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()}));
    const double twice_area = cross.norm();
    normals_[t] = twice_area > kThinnestFacing * longest ? Vec3(cross / twice_area) : Vec3::Zero();
  }
  nodes_.reserve(count);
  if (count > 0) build(0, count, centres);
}

void TriangleTree::build(std::uint32_t from, std::uint32_t to, const std::vector<Vec3>& centres) {
  const auto self = nodes_.size();
  nodes_.emplace_back();
  Box3 box, of_centres;
  for (std::uint32_t i = from; i < to; ++i) {
    for (int k = 0; k < 3; ++k) box.extend(corner(order_[i], k));
    of_centres.extend(centres[order_[i]]);
  }
  nodes_[self].box = box;
  if (to - from <= kLeaf) {
    nodes_[self].first = from;
    nodes_[self].count = to - from;
    std::sort(order_.begin() + from, order_.begin() + to);
    return;
  }
  int axis = 0;
  of_centres.sizes().maxCoeff(&axis);
  const auto middle = from + (to - from) / 2;
  std::nth_element(order_.begin() + from, order_.begin() + middle, order_.begin() + to,
                   [&](std::uint32_t s, std::uint32_t t) {
                     const double x = centres[s][axis], y = centres[t][axis];
                     return x != y ? x < y : s < t;
                   });
  build(from, middle, centres);
  nodes_[self].first = static_cast<std::uint32_t>(nodes_.size());
  build(middle, to, centres);
}

std::optional<SurfacePoint> TriangleTree::nearest(const Vec3& point, double within_mm,
                                                  const Facing* facing) const {
  if (nodes_.empty()) return std::nullopt;
  std::optional<SurfacePoint> best;
  double best2 = within_mm * within_mm;
  std::array<std::uint32_t, 128> open;
  std::size_t depth = 0;
  open[depth++] = 0;
  while (depth > 0) {
    const auto index = open[--depth];
    const Node& node = nodes_[index];
    if (node.box.squaredExteriorDistance(point) > best2) continue;
    if (node.count == 0) {
      const auto near = index + 1, far = node.first;
      const bool swap = nodes_[far].box.squaredExteriorDistance(point) <
                        nodes_[near].box.squaredExteriorDistance(point);
      assert(depth + 2 <= open.size());
      open[depth++] = swap ? near : far;
      open[depth++] = swap ? far : near;
      continue;
    }
    for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
      const auto t = order_[i];
      if (facing && !(normals_[t].dot(facing->direction) >= facing->least_cosine)) continue;
      const Vec3 at = closest_on_triangle(point, corner(t, 0), corner(t, 1), corner(t, 2));
      const double distance2 = (at - point).squaredNorm();
      if (distance2 < best2 || (distance2 == best2 && (!best || t < best->triangle))) {
        best2 = distance2;
        best = SurfacePoint{at, t, 0};
      }
    }
  }
  if (best) best->distance = std::sqrt(best2);
  return best;
}

std::optional<SurfacePoint> TriangleTree::closest(const Vec3& point, double within_mm) const {
  return nearest(point, within_mm, nullptr);
}

std::optional<SurfacePoint> TriangleTree::closest_facing(const Vec3& point, double within_mm,
                                                         const Facing& facing) const {
  return nearest(point, within_mm, &facing);
}

// Signed crossings of the surface along a ray, or nothing when the ray grazes an edge.
std::optional<int> TriangleTree::crossings(const Vec3& point, const Vec3& direction) const {
  int winding = 0;
  std::array<std::uint32_t, 128> open;
  std::size_t depth = 0;
  open[depth++] = 0;
  const Vec3 inverse = direction.cwiseInverse();
  while (depth > 0) {
    const auto index = open[--depth];
    const Node& node = nodes_[index];
    const Eigen::Array3d low = (node.box.min() - point).cwiseProduct(inverse).array();
    const Eigen::Array3d high = (node.box.max() - point).cwiseProduct(inverse).array();
    const double enters = low.min(high).maxCoeff(), leaves = low.max(high).minCoeff();
    if (leaves < 0 || enters > leaves + 1e-9 * std::abs(leaves)) continue;
    if (node.count == 0) {
      assert(depth + 2 <= open.size());
      open[depth++] = index + 1;
      open[depth++] = node.first;
      continue;
    }
    for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
      const Vec3 a = corner(order_[i], 0) - point, b = corner(order_[i], 1) - point,
                 c = corner(order_[i], 2) - point;
      // Volumes of the tetrahedra the ray's line makes with the edges.
      const double u = direction.dot(b.cross(c)), v = direction.dot(c.cross(a)),
                   w = direction.dot(a.cross(b));
      const double doubt = 1e-12 * (a.squaredNorm() + b.squaredNorm() + c.squaredNorm());
      const bool some_below = u < -doubt || v < -doubt || w < -doubt;
      const bool some_above = u > doubt || v > doubt || w > doubt;
      if (some_below && some_above) continue;
      if (std::min({std::abs(u), std::abs(v), std::abs(w)}) <= doubt) return std::nullopt;
      if (a.dot(b.cross(c)) * (u + v + w) > 0) winding += u > 0 ? 1 : -1;
    }
  }
  return winding;
}

bool TriangleTree::contains(const Vec3& point) const {
  if (nodes_.empty() || !nodes_[0].box.contains(point)) return false;
  // No direction is special; these are merely unlikely to lie in a plane or along an edge of a
  // part.
  static const std::array<Vec3, 6> kRays{
      Vec3(0.2113, 0.3571, 0.9099),    Vec3(-0.4013, 0.8317, 0.3821),
      Vec3(0.7919, -0.1237, 0.5981),   Vec3(0.3109, 0.5407, -0.7817),
      Vec3(-0.6473, -0.5189, -0.5581), Vec3(0.1013, -0.9239, 0.3691)};
  for (const Vec3& ray : kRays) {
    if (const auto winding = crossings(point, ray)) return *winding > 0;
  }
  return reforge::contains(*mesh_, point);
}

bool TriangleTree::may_meet(const TriangleTree& a, std::uint32_t one, const TriangleTree& b,
                            std::uint32_t other) {
  const Triangle s{a.corner(one, 0), a.corner(one, 1), a.corner(one, 2)};
  const Triangle t{b.corner(other, 0), b.corner(other, 1), b.corner(other, 2)};
  for (int k = 0; k < 3; ++k) {
    if (std::max({s[0][k], s[1][k], s[2][k]}) < std::min({t[0][k], t[1][k], t[2][k]})) return false;
    if (std::max({t[0][k], t[1][k], t[2][k]}) < std::min({s[0][k], s[1][k], s[2][k]})) return false;
  }
  return triangles_may_meet(s, t);
}

}  // namespace reforge

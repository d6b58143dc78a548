// A tree of boxes over a mesh's triangles: closest points, point in solid, and which triangles of
// two meshes may meet.
//
// Purpose: thousands of questions about one surface in microseconds each, without CGAL.
// Units: mm. Exactness: double arithmetic. `contains` counts signed crossings along a ray and takes
//   another ray when one passes too near an edge; within 1e-9 mm of the surface it may say either.
// Invariants: answers depend on the mesh alone (ties go to the lowest triangle number).
#pragma once

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "planner/geometry/mesh.h"

namespace reforge {

struct SurfacePoint {
  Vec3 point = Vec3::Zero();
  std::uint32_t triangle = 0;
  double distance = 0;  // from the point asked for, mm
};

// Triangles whose unit normals n have n . direction >= least_cosine. Triangles thinner than
// kThinnestFacing have no reliable normal and never face anywhere.
struct Facing {
  Vec3 direction;
  double least_cosine;
};
constexpr double kThinnestFacing = 1e-3;  // mm, smallest height of a triangle

class TriangleTree {
 public:
  // The mesh must outlive the tree.
  explicit TriangleTree(const TriangleMesh& mesh);

  // The closest point of the surface not farther than `within_mm`, if any.
  std::optional<SurfacePoint> closest(const Vec3& point, double within_mm) const;
  // The same among the triangles that face as asked.
  std::optional<SurfacePoint> closest_facing(const Vec3& point, double within_mm,
                                             const Facing& facing) const;

  // Whether a closed mesh winds around the point.
  bool contains(const Vec3& point) const;

  // Unit normal of a triangle; zero for one thinner than kThinnestFacing.
  const Vec3& normal(std::uint32_t triangle) const { return normals_[triangle]; }
  const TriangleMesh& mesh() const { return *mesh_; }

  // Visits all pairs (triangle of a, triangle of b) that may share a point: none that do is left
  // out, some that do not are visited.
  template <typename Visit>
  static void visit_pairs(const TriangleTree& a, const TriangleTree& b, Visit visit) {
    if (a.nodes_.empty() || b.nodes_.empty()) return;
    std::vector<std::pair<std::uint32_t, std::uint32_t>> open{{0, 0}};
    while (!open.empty()) {
      const auto [i, j] = open.back();
      open.pop_back();
      const Node &p = a.nodes_[i], &q = b.nodes_[j];
      if (!p.box.intersects(q.box)) continue;
      if (p.count > 0 && q.count > 0) {
        for (std::uint32_t s = 0; s < p.count; ++s) {
          for (std::uint32_t t = 0; t < q.count; ++t) {
            const auto one = a.order_[p.first + s], other = b.order_[q.first + t];
            if (may_meet(a, one, b, other)) visit(one, other);
          }
        }
      } else if (q.count > 0 || (p.count == 0 && p.box.diagonal().squaredNorm() >=
                                                     q.box.diagonal().squaredNorm())) {
        open.emplace_back(i + 1, j);
        open.emplace_back(p.first, j);
      } else {
        open.emplace_back(i, j + 1);
        open.emplace_back(i, q.first);
      }
    }
  }

 private:
  // A leaf holds order_[first, first + count); an inner node's children are the next one and
  // `first`.
  struct Node {
    Box3 box;
    std::uint32_t first = 0, count = 0;
  };
  void build(std::uint32_t from, std::uint32_t to, const std::vector<Vec3>& centres);
  std::optional<SurfacePoint> nearest(const Vec3& point, double within_mm,
                                      const Facing* facing) const;
  std::optional<int> crossings(const Vec3& point, const Vec3& direction) const;
  static bool may_meet(const TriangleTree& a, std::uint32_t one, const TriangleTree& b,
                       std::uint32_t other);
  const Vec3& corner(std::uint32_t triangle, int k) const {
    return mesh_->vertices[mesh_->triangles[triangle][k]];
  }

  const TriangleMesh* mesh_;
  std::vector<Node> nodes_;
  std::vector<std::uint32_t> order_;
  std::vector<Vec3> normals_;
};

}  // namespace reforge

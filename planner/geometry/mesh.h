// Triangle mesh: an indexed surface in millimetres. Plain data; CGAL stays behind cgal_mesh.h.
//
// A *solid* is a mesh that is closed, oriented outward, free of self-intersection and not empty;
// the empty mesh (no vertices, no triangles) stands for the empty volume. mesh_io.h reads,
// mesh_check.h decides whether a mesh is a solid.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

namespace reforge {

using Vec3 = Eigen::Vector3d;
using Box3 = Eigen::AlignedBox3d;

struct TriangleMesh {
  std::vector<Vec3> vertices;                           // mm
  std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise seen from outside

  bool empty() const { return triangles.empty(); }
};

// Signed volume by the divergence theorem, mm^3; exact for a solid up to rounding.
double volume(const TriangleMesh& mesh);
// Sum of triangle areas, mm^2.
double area(const TriangleMesh& mesh);
Box3 bounds(const TriangleMesh& mesh);
TriangleMesh translated(TriangleMesh mesh, const Vec3& by);
TriangleMesh transformed(TriangleMesh mesh, const Eigen::Isometry3d& by);

}  // namespace reforge

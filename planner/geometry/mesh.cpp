#include "planner/geometry/mesh.h"

namespace reforge {

double volume(const TriangleMesh& mesh) {
  if (mesh.vertices.empty()) return 0;
  // Measured from the first vertex: far from the origin the terms would cancel badly.
  const Vec3 origin = mesh.vertices.front();
  double six_volumes = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    six_volumes += (mesh.vertices[a] - origin)
                       .dot((mesh.vertices[b] - origin).cross(mesh.vertices[c] - origin));
  }
  return six_volumes / 6;
}

double area(const TriangleMesh& mesh) {
  double twice = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    twice +=
        (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm();
  }
  return twice / 2;
}

Box3 bounds(const TriangleMesh& mesh) {
  Box3 box;
  for (const auto& triangle : mesh.triangles) {
    for (const auto vertex : triangle) box.extend(mesh.vertices[vertex]);
  }
  return box;
}

TriangleMesh translated(TriangleMesh mesh, const Vec3& by) {
  for (Vec3& vertex : mesh.vertices) vertex += by;
  return mesh;
}

TriangleMesh transformed(TriangleMesh mesh, const Eigen::Isometry3d& by) {
  for (Vec3& vertex : mesh.vertices) vertex = by * vertex;
  return mesh;
}

}  // namespace reforge

// g++ 12 takes CGAL's empty function objects for uninitialised ones once everything is inlined.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>

#include <algorithm>

#include "planner/geometry/cgal_mesh.h"

namespace reforge {

std::optional<Vec3> self_intersects(const TriangleMesh& mesh) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using SurfaceMesh = CGAL::Surface_mesh<Kernel::Point_3>;
  SurfaceMesh surface;
  std::vector<SurfaceMesh::Vertex_index> vertices;
  for (const Vec3& p : mesh.vertices) {
    vertices.push_back(surface.add_vertex(Kernel::Point_3(p.x(), p.y(), p.z())));
  }
  for (const auto& [a, b, c] : mesh.triangles) {
    const auto face = surface.add_face(vertices[a], vertices[b], vertices[c]);
    assert(face != SurfaceMesh::null_face());
    static_cast<void>(face);
  }
  std::vector<std::pair<SurfaceMesh::Face_index, SurfaceMesh::Face_index>> pairs;
  CGAL::Polygon_mesh_processing::self_intersections(surface, std::back_inserter(pairs));
  if (pairs.empty()) return std::nullopt;
  const auto first = std::min_element(pairs.begin(), pairs.end())->first;
  const auto& triangle = mesh.triangles[static_cast<std::uint32_t>(first)];
  return (mesh.vertices[triangle[0]] + mesh.vertices[triangle[1]] + mesh.vertices[triangle[2]]) / 3;
}

}  // namespace reforge

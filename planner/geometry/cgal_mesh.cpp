// g++ 12 takes CGAL's empty function objects for uninitialised ones once everything is inlined.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

#include "planner/geometry/cgal_mesh.h"

#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/corefinement.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Side_of_triangle_mesh.h>
#include <CGAL/Surface_mesh.h>

#include <algorithm>
#include <map>
#include <memory>

#include "planner/geometry/mesh_io.h"
#include "planner/geometry/mesh_parsers.h"
#include "planner/geometry/mesh_topology.h"

namespace reforge {
namespace {

namespace PMP = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_exact_constructions_kernel;
using Point = Kernel::Point_3;
using Surface = CGAL::Surface_mesh<Point>;
using Side = CGAL::Side_of_triangle_mesh<Surface, Kernel>;
using Tree =
    CGAL::AABB_tree<CGAL::AABB_traits<Kernel, CGAL::AABB_face_graph_triangle_primitive<Surface>>>;

Surface to_surface(const TriangleMesh& mesh) {
  Surface surface;
  std::vector<Point> points;
  for (const Vec3& p : mesh.vertices) points.emplace_back(p.x(), p.y(), p.z());
  const auto faults = edge_faults(mesh);
  if (faults.crowded > 0 || pinched_vertex(mesh)) {
    // A result of an earlier boolean may touch itself along an edge: vertices are doubled there.
    std::vector<std::vector<std::size_t>> polygons;
    for (const auto& [a, b, c] : mesh.triangles) polygons.push_back({a, b, c});
    PMP::orient_polygon_soup(points, polygons);
    PMP::polygon_soup_to_polygon_mesh(points, polygons, surface);
    return surface;
  }
  std::vector<Surface::Vertex_index> vertices;
  for (const Point& point : points) vertices.push_back(surface.add_vertex(point));
  for (const auto& [a, b, c] : mesh.triangles) {
    surface.add_face(vertices[a], vertices[b], vertices[c]);
  }
  return surface;
}

Vec3 rounded(const Point& point) {
  // exact() first: the double must not depend on how far the lazy number has been evaluated.
  const auto& exact = point.exact();
  return rounded_to_float(Vec3(CGAL::to_double(exact.x()), CGAL::to_double(exact.y()),
                               CGAL::to_double(exact.z())));
}

// One of the two surfaces after both have been cut along each other.
struct Cut {
  Surface surface;
  Surface::Property_map<Surface::Edge_index, bool> is_seam;
  std::vector<Vec3> points;                             // by vertex, rounded
  std::vector<std::array<std::uint32_t, 3>> triangles;  // by face; shared vertex numbers
  std::vector<Surface::Face_index> faces;
  std::vector<std::uint32_t> patch;  // by face: pieces between seams
  std::uint32_t patches = 0;
};

void number_patches(Cut& cut) {
  constexpr auto kNone = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> by_face(
      cut.surface.num_faces() + cut.surface.number_of_removed_faces(), kNone);
  for (const auto start : cut.surface.faces()) {
    if (by_face[start] != kNone) continue;
    std::vector<Surface::Face_index> front{start};
    by_face[start] = cut.patches;
    while (!front.empty()) {
      const auto face = front.back();
      front.pop_back();
      for (const auto h : halfedges_around_face(halfedge(face, cut.surface), cut.surface)) {
        const auto other = cut.surface.face(opposite(h, cut.surface));
        if (cut.is_seam[cut.surface.edge(h)] || other == Surface::null_face()) continue;
        if (by_face[other] != kNone) continue;
        by_face[other] = cut.patches;
        front.push_back(other);
      }
    }
    ++cut.patches;
  }
  for (const auto face : cut.surface.faces()) {
    cut.faces.push_back(face);
    cut.patch.push_back(by_face[face]);
  }
}

enum class Where { kOutside, kInside, kSameSurface, kOppositeSurface };

using Triple = std::array<std::uint32_t, 3>;

Triple sorted(Triple t) {
  std::sort(t.begin(), t.end());
  return t;
}
bool is_even_permutation(const Triple& t) {
  return (t[0] < t[1]) + (t[1] < t[2]) + (t[2] < t[0]) == 2;
}

// Where each patch of `cut` lies in respect of the solid bounded by `other`.
std::vector<Where> locate(const Cut& cut, const Cut& other, const std::vector<Vec3>& vertices) {
  // Triangles that both surfaces have need no geometry.
  std::map<Triple, bool> of_other;
  for (const Triple& t : other.triangles) of_other[sorted(t)] = is_even_permutation(t);

  std::vector<std::size_t> largest(cut.patches, cut.faces.size());
  std::vector<double> size(cut.patches, -1);
  for (std::size_t f = 0; f < cut.faces.size(); ++f) {
    const Triple& t = cut.triangles[f];
    const double twice_area =
        (vertices[t[1]] - vertices[t[0]]).cross(vertices[t[2]] - vertices[t[0]]).norm();
    if (twice_area > size[cut.patch[f]]) {
      size[cut.patch[f]] = twice_area;
      largest[cut.patch[f]] = f;
    }
  }
  std::unique_ptr<Side> side;
  std::unique_ptr<Tree> tree;
  std::vector<Where> where(cut.patches);
  for (std::uint32_t p = 0; p < cut.patches; ++p) {
    const std::size_t f = largest[p];
    const auto twin = of_other.find(sorted(cut.triangles[f]));
    if (twin != of_other.end() && size[p] > 0) {
      where[p] = twin->second == is_even_permutation(cut.triangles[f]) ? Where::kSameSurface
                                                                       : Where::kOppositeSurface;
      continue;
    }
    if (!side) side = std::make_unique<Side>(other.surface);
    std::vector<Point> corner;
    const auto h = halfedge(cut.faces[f], cut.surface);
    for (const auto v : vertices_around_face(h, cut.surface))
      corner.push_back(cut.surface.point(v));
    const Point middle = CGAL::centroid(corner[0], corner[1], corner[2]);
    const auto found = (*side)(middle);
    if (found != CGAL::ON_BOUNDARY) {
      where[p] = found == CGAL::ON_BOUNDED_SIDE ? Where::kInside : Where::kOutside;
      continue;
    }
    if (!tree) {
      tree = std::make_unique<Tree>(faces(other.surface).begin(), faces(other.surface).end(),
                                    other.surface);
    }
    const auto beneath = tree->closest_point_and_primitive(middle).second;
    std::vector<Point> facing;
    for (const auto v : vertices_around_face(halfedge(beneath, other.surface), other.surface)) {
      facing.push_back(other.surface.point(v));
    }
    const auto agree = CGAL::scalar_product(CGAL::normal(corner[0], corner[1], corner[2]),
                                            CGAL::normal(facing[0], facing[1], facing[2]));
    where[p] = agree > 0 ? Where::kSameSurface : Where::kOppositeSurface;
  }
  return where;
}

// Gives both cuts' vertices common numbers by their rounded coordinates.
std::vector<Vec3> number_vertices(Cut& a, Cut& b) {
  std::vector<Vec3> corners;
  for (Cut* cut : {&a, &b}) {
    std::vector<Vec3> at(cut->surface.num_vertices() + cut->surface.number_of_removed_vertices());
    for (const auto v : cut->surface.vertices()) at[v] = rounded(cut->surface.point(v));
    for (const auto face : cut->faces) {
      for (const auto v : vertices_around_face(halfedge(face, cut->surface), cut->surface)) {
        corners.push_back(at[v]);
      }
    }
  }
  TriangleMesh indexed = mesh_parsers::index_corners(corners);
  const auto split = indexed.triangles.begin() + static_cast<std::ptrdiff_t>(a.faces.size());
  a.triangles.assign(indexed.triangles.begin(), split);
  b.triangles.assign(split, indexed.triangles.end());
  return std::move(indexed.vertices);
}

CellComplex overlay_of(const TriangleMesh& mesh_a, const TriangleMesh& mesh_b) {
  Cut a, b;
  a.surface = to_surface(mesh_a);
  b.surface = to_surface(mesh_b);
  a.is_seam = a.surface.add_property_map<Surface::Edge_index, bool>("e:seam", false).first;
  b.is_seam = b.surface.add_property_map<Surface::Edge_index, bool>("e:seam", false).first;
  PMP::corefine(
      a.surface, b.surface,
      CGAL::parameters::edge_is_constrained_map(a.is_seam).throw_on_self_intersection(true),
      CGAL::parameters::edge_is_constrained_map(b.is_seam));
  number_patches(a);
  number_patches(b);
  CellComplex result;
  result.vertices = number_vertices(a, b);
  const auto where_a = locate(a, b, result.vertices);
  const auto where_b = locate(b, a, result.vertices);
  auto& facets = result.facets;
  for (std::size_t f = 0; f < a.faces.size(); ++f) {
    switch (where_a[a.patch[f]]) {
      case Where::kOutside:
        facets.push_back({a.triangles[f], 0, 1, 0, 0});
        break;
      case Where::kInside:
        facets.push_back({a.triangles[f], 2, 3, 0, 0});
        break;
      case Where::kSameSurface:
        facets.push_back({a.triangles[f], 0, 3, 0, 0});
        break;
      case Where::kOppositeSurface:
        facets.push_back({a.triangles[f], 2, 1, 0, 0});
        break;
    }
  }
  for (std::size_t f = 0; f < b.faces.size(); ++f) {
    switch (where_b[b.patch[f]]) {
      case Where::kOutside:
        facets.push_back({b.triangles[f], 0, 2, 0, 0});
        break;
      case Where::kInside:
        facets.push_back({b.triangles[f], 1, 3, 0, 0});
        break;
      case Where::kSameSurface:
      case Where::kOppositeSurface:
        break;  // A's facets stand for both
    }
  }
  tidy(result);
  for (std::uint32_t f = 0; f < facets.size(); ++f) facets[f].origin = f;
  return result;
}

Result<TriangleMesh> read_off(const TriangleMesh& a, const TriangleMesh& b, unsigned labels) {
  if (a.empty() || b.empty()) {
    const bool keeps_a = labels & 2, keeps_b = labels & 4;
    if (!a.empty() && keeps_a) return rounded_to_float(a);
    if (!b.empty() && keeps_b) return rounded_to_float(b);
    return TriangleMesh{};
  }
  const auto both = overlay(a, b);
  if (!both) return both.error();
  return surface_of(*both, labels);
}

}  // namespace

Result<CellComplex> overlay(const TriangleMesh& a, const TriangleMesh& b) {
  assert(!a.empty() && !b.empty());
  const auto failed = [](const std::string& why) {
    return Error{Code::kBooleanFailed,
                 "The exact volumes of the two parts could not be computed: " + why + "."};
  };
  try {
    CellComplex result = overlay_of(a, b);
    for (unsigned label = 1; label < 4; ++label) {
      if (!is_closed(surface_of(result, 1u << label))) return failed("their pieces do not close");
    }
    return result;
  } catch (const PMP::Corefinement::Self_intersection_exception&) {
    return failed("a surface passes through itself where the two meet");
  } catch (const std::exception& problem) {
    return failed(std::string("CGAL reports: ") + problem.what());
  }
}

Result<TriangleMesh> boolean_intersection(const TriangleMesh& a, const TriangleMesh& b) {
  return read_off(a, b, 1u << 3);
}
Result<TriangleMesh> boolean_difference(const TriangleMesh& a, const TriangleMesh& b) {
  return read_off(a, b, 1u << 1);
}
Result<TriangleMesh> boolean_union(const TriangleMesh& a, const TriangleMesh& b) {
  return read_off(a, b, 1u << 1 | 1u << 2 | 1u << 3);
}

}  // namespace reforge

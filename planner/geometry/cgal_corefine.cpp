// g++ 12 takes CGAL's empty function objects for uninitialised ones once everything is inlined.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/corefinement.h>
#include <CGAL/Surface_mesh.h>

#include <algorithm>
#include <map>

#include "planner/geometry/corefine.h"
#include "planner/geometry/mesh_io.h"

namespace reforge {
namespace {

namespace PMP = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_exact_constructions_kernel;
using Point = Kernel::Point_3;
using Surface = CGAL::Surface_mesh<Point>;
using Vertex = Surface::Vertex_index;
using Face = Surface::Face_index;
using Halfedge = Surface::Halfedge_index;
constexpr auto kNone = static_cast<std::uint32_t>(-1);

// A surface while it is being cut.
struct Sheet {
  Surface surface;
  Surface::Property_map<Vertex, std::uint32_t> given;  // number of a given vertex, else kNone
  Surface::Property_map<Face, std::uint32_t> origin;
  std::vector<std::vector<std::array<Vertex, 2>>> seams;  // by the surface met
};

void fill(Sheet& sheet, const TriangleMesh& mesh) {
  sheet.given = sheet.surface.add_property_map<Vertex, std::uint32_t>("v:given", kNone).first;
  sheet.origin = sheet.surface.add_property_map<Face, std::uint32_t>("f:origin", kNone).first;
  std::vector<Vertex> of_number(mesh.vertices.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const auto number : mesh.triangles[t]) {
      Vertex& vertex = of_number[number];
      if (vertex != Vertex()) continue;
      const Vec3& p = mesh.vertices[number];
      vertex = sheet.surface.add_vertex(Point(p.x(), p.y(), p.z()));
      sheet.given[vertex] = number;
    }
    const auto& [i, j, k] = mesh.triangles[t];
    const Face face = sheet.surface.add_face(of_number[i], of_number[j], of_number[k]);
    if (face == Surface::null_face()) {
      throw std::runtime_error(
          "a surface has an edge with more than two triangles or a pinched vertex");
    }
    sheet.origin[face] = t;
  }
}

// Hands each new face the origin of the face it is cut from.
struct KeepOrigins : PMP::Corefinement::Default_visitor<Surface> {
  std::map<const Surface*, Sheet*> sheets;
  std::uint32_t current = kNone;
  void before_subface_creations(Face old, Surface& surface) {
    current = sheets.at(&surface)->origin[old];
  }
  void after_subface_created(Face created, Surface& surface) {
    sheets.at(&surface)->origin[created] = current;
  }
};

struct Seam {
  std::array<Vertex, 2> in_first, in_other;
};

// Cuts both and returns the edges they share.
std::vector<Seam> cut(Sheet& first, Sheet& other) {
  using Marks = Surface::Property_map<Surface::Edge_index, bool>;
  Marks of_first = first.surface.add_property_map<Surface::Edge_index, bool>("e:s", false).first;
  Marks of_other = other.surface.add_property_map<Surface::Edge_index, bool>("e:s", false).first;
  KeepOrigins visitor;
  visitor.sheets = {{&first.surface, &first}, {&other.surface, &other}};
  PMP::corefine(
      first.surface, other.surface,
      CGAL::parameters::edge_is_constrained_map(of_first).throw_on_self_intersection(true).visitor(
          visitor),
      CGAL::parameters::edge_is_constrained_map(of_other));
  std::map<Point, Vertex, Kernel::Less_xyz_3> at;
  for (const auto edge : other.surface.edges()) {
    if (!of_other[edge]) continue;
    for (const int end : {0, 1}) {
      const Vertex v = other.surface.vertex(edge, static_cast<unsigned>(end));
      at.emplace(other.surface.point(v), v);
    }
  }
  std::vector<Seam> seams;
  for (const auto edge : first.surface.edges()) {
    if (!of_first[edge]) continue;
    const Vertex a = first.surface.vertex(edge, 0), b = first.surface.vertex(edge, 1);
    seams.push_back({{a, b}, {at.at(first.surface.point(a)), at.at(first.surface.point(b))}});
  }
  first.surface.remove_property_map(of_first);
  other.surface.remove_property_map(of_other);
  return seams;
}

// The vertices on the straight way from one vertex to another along edges, both included.
std::vector<Vertex> straight_path(const Surface& surface, Vertex from, Vertex to) {
  std::vector<Vertex> path{from};
  while (path.back() != to) {
    const Vertex here = path.back();
    Vertex next;
    for (const Halfedge h : CGAL::halfedges_around_source(here, surface)) {
      const Vertex v = surface.target(h);
      if (v == to || CGAL::collinear_are_ordered_along_line(surface.point(here), surface.point(v),
                                                            surface.point(to))) {
        if (v != to && !CGAL::collinear(surface.point(here), surface.point(v), surface.point(to)))
          continue;
        next = v;
        break;
      }
    }
    if (next == Vertex()) throw std::runtime_error("an edge lost its parts");
    path.push_back(next);
  }
  return path;
}

// Puts a vertex on the edge from h's source to its target, and returns the part that leads on.
Halfedge split(Sheet& sheet, Halfedge h, const Point& at, Vertex& created) {
  Surface& surface = sheet.surface;
  const Halfedge before = CGAL::Euler::split_edge(h, surface);
  created = surface.target(before);
  surface.point(created) = at;
  const auto halve = [&](Halfedge into, Halfedge opposite_corner) {
    const auto origin = sheet.origin[surface.face(into)];
    const Halfedge diagonal = CGAL::Euler::split_face(into, opposite_corner, surface);
    sheet.origin[surface.face(diagonal)] = origin;
    sheet.origin[surface.face(surface.opposite(diagonal))] = origin;
  };
  if (!surface.is_border(before)) halve(before, surface.next(h));
  const Halfedge back = surface.opposite(h);
  if (!surface.is_border(back)) halve(back, surface.next(surface.opposite(before)));
  return h;
}

// Where a later cut has divided an edge of `first` that is a seam with `other`, divides it there
// too.
void follow(Sheet& first, Sheet& other, const std::vector<Seam>& seams) {
  auto& in_first = first.seams.emplace_back();
  auto& in_other = other.seams.emplace_back();
  for (const Seam& seam : seams) {
    const auto path = straight_path(first.surface, seam.in_first[0], seam.in_first[1]);
    Halfedge h = other.surface.halfedge(seam.in_other[0], seam.in_other[1]);
    Vertex last = seam.in_other[0];
    for (std::size_t i = 1; i < path.size(); ++i) {
      in_first.push_back({path[i - 1], path[i]});
      Vertex here = seam.in_other[1];
      if (i + 1 < path.size()) h = split(other, h, first.surface.point(path[i]), here);
      in_other.push_back({last, here});
      last = here;
    }
  }
}

Vec3 rounded(const Point& point) {
  // exact() first: the double must not depend on how far the lazy number has been evaluated.
  const auto& exact = point.exact();
  return rounded_to_float(
      Vec3(CGAL::to_double(exact.x()), CGAL::to_double(exact.y()), CGAL::to_double(exact.z())));
}

CutSurface read(const Sheet& sheet, const TriangleMesh& given) {
  CutSurface result;
  result.mesh.vertices = given.vertices;
  std::vector<std::uint32_t> number(sheet.surface.num_vertices());
  for (const Vertex v : sheet.surface.vertices()) {
    number[v] = sheet.given[v];
    if (number[v] != kNone) continue;
    number[v] = static_cast<std::uint32_t>(result.mesh.vertices.size());
    result.mesh.vertices.push_back(rounded(sheet.surface.point(v)));
  }
  for (const Face face : sheet.surface.faces()) {
    std::array<std::uint32_t, 3> triangle{};
    std::size_t k = 0;
    for (const Vertex v : vertices_around_face(halfedge(face, sheet.surface), sheet.surface)) {
      triangle[k++] = number[v];
    }
    result.mesh.triangles.push_back(triangle);
    result.origins.push_back(sheet.origin[face]);
  }
  for (const auto& met : sheet.seams) {
    auto& seams = result.seams.emplace_back();
    for (const auto& [a, b] : met) {
      seams.push_back({std::min(number[a], number[b]), std::max(number[a], number[b])});
    }
  }
  return result;
}

std::vector<CutSurface> corefined(const TriangleMesh& first,
                                  const std::vector<TriangleMesh>& others) {
  std::vector<Sheet> sheets(1 + others.size());
  fill(sheets[0], first);
  std::vector<std::vector<Seam>> seams;
  for (std::size_t i = 0; i < others.size(); ++i) {
    fill(sheets[i + 1], others[i]);
    seams.push_back(cut(sheets[0], sheets[i + 1]));
  }
  std::vector<CutSurface> result(sheets.size());
  for (std::size_t i = 0; i < others.size(); ++i) {
    follow(sheets[0], sheets[i + 1], seams[i]);
    result[i + 1] = read(sheets[i + 1], others[i]);
  }
  result[0] = read(sheets[0], first);
  return result;
}

}  // namespace

Result<std::vector<CutSurface>> corefine(const TriangleMesh& first,
                                         const std::vector<TriangleMesh>& others) {
  const auto failed = [](const std::string& why) {
    return Error{Code::kBooleanFailed,
                 "The exact volumes of the two parts could not be computed: " + why + "."};
  };
  try {
    return corefined(first, others);
  } catch (const PMP::Corefinement::Self_intersection_exception&) {
    return failed("a surface passes through itself where the two meet");
  } catch (const std::exception& problem) {
    return failed(std::string("CGAL reports: ") + problem.what());
  }
}

}  // namespace reforge

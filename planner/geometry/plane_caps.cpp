// Symbols: as in plane_caps.h.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"  // CGAL's empty function objects, g++ 12
#endif

#include "planner/geometry/plane_caps.h"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Constrained_triangulation_plus_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "planner/geometry/height_map.h"
#include "planner/geometry/mesh_io.h"

namespace reforge {
namespace {

constexpr auto kNew = static_cast<std::uint32_t>(-1);

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
struct Corner {
  std::uint32_t number = kNew;
};
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<Corner, Kernel>;
using FaceBase =
    CGAL::Triangulation_face_base_with_info_2<std::optional<int>, Kernel,
                                              CGAL::Constrained_triangulation_face_base_2<Kernel>>;
using Delaunay = CGAL::Constrained_Delaunay_triangulation_2<
    Kernel, CGAL::Triangulation_data_structure_2<VertexBase, FaceBase>, CGAL::Exact_predicates_tag>;
using Triangulation = CGAL::Constrained_triangulation_plus_2<Delaunay>;

UndirectedEdge undirected(std::uint32_t a, std::uint32_t b) {
  return {std::min(a, b), std::max(a, b)};
}

using Flat = Eigen::Vector2d;
struct Site {
  Flat at;
  std::uint32_t number;
};

// The outlines' corners in the plane, from left to right.
std::vector<Site> sites_of(const std::vector<Vec3>& vertices, const Outline& outline,
                           const Frame& frame) {
  std::vector<std::uint32_t> numbers;
  for (const auto& [edge, turns] : outline) {
    numbers.push_back(edge.first);
    numbers.push_back(edge.second);
  }
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
  std::vector<Site> sites;
  for (const auto number : numbers) {
    sites.push_back({frame.to_local(vertices[number]).head<2>(), number});
  }
  std::sort(sites.begin(), sites.end(), [](const Site& a, const Site& b) {
    return std::pair(a.at.x(), a.number) < std::pair(b.at.x(), b.number);
  });
  return sites;
}

// Corners that fall together: each goes to the lowest number near it that stays.
void find_merged(const std::vector<Site>& sites, double within, CapChanges& changes) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> near;  // higher number first
  for (std::size_t i = 0; i < sites.size(); ++i) {
    for (std::size_t j = i + 1; j < sites.size(); ++j) {
      if (sites[j].at.x() - sites[i].at.x() > within) break;
      if ((sites[j].at - sites[i].at).norm() > within) continue;
      near.emplace_back(std::max(sites[i].number, sites[j].number),
                        std::min(sites[i].number, sites[j].number));
    }
  }
  std::sort(near.begin(), near.end());
  for (const auto& [from, to] : near) {
    if (!changes.merged.count(to)) changes.merged.try_emplace(from, to);
  }
}

// Corners that lie on edges they do not end.
void find_divided(const std::vector<Site>& sites, const Outline& outline,
                  const std::map<std::uint32_t, Flat>& at, double within, CapChanges& changes) {
  for (const auto& [edge, turns] : outline) {
    const Flat &from = at.at(edge.first), &to = at.at(edge.second);
    const Flat along = to - from;
    const double length = along.norm();
    const double left = std::min(from.x(), to.x()) - within,
                 right = std::max(from.x(), to.x()) + within;
    auto site = std::lower_bound(sites.begin(), sites.end(), left,
                                 [](const Site& s, double x) { return s.at.x() < x; });
    std::vector<std::pair<double, std::uint32_t>> on_edge;
    for (; site != sites.end() && site->at.x() <= right; ++site) {
      const Flat offset = site->at - from;
      const double way = offset.dot(along) / length;
      if (!(way > within && way < length - within)) continue;
      if (std::abs(along.x() * offset.y() - along.y() * offset.x()) > within * length) continue;
      on_edge.emplace_back(way, site->number);
    }
    std::sort(on_edge.begin(), on_edge.end());
    for (const auto& [way, number] : on_edge) changes.divided[edge].push_back(number);
  }
}

// The outlines as constraints, and the corners that make up each.
struct Drawing {
  Triangulation triangulation;
  std::map<UndirectedEdge, std::vector<Triangulation::Vertex_handle>> path;  // both ends included
};

void draw(Drawing& drawing, const std::vector<Site>& sites, const Outline& outline) {
  std::map<std::uint32_t, Triangulation::Vertex_handle> handle;
  for (const Site& site : sites) {
    const auto vertex = drawing.triangulation.insert(Kernel::Point_2(site.at.x(), site.at.y()));
    vertex->info().number = site.number;
    handle[site.number] = vertex;
  }
  std::vector<std::pair<UndirectedEdge, Triangulation::Constraint_id>> drawn;
  for (const auto& [edge, turns] : outline) {
    drawn.emplace_back(edge, drawing.triangulation.insert_constraint(handle.at(edge.first),
                                                                     handle.at(edge.second)));
  }
  for (const auto& [edge, id] : drawn) {
    auto& path = drawing.path[edge];
    for (auto v = drawing.triangulation.vertices_in_constraint_begin(id);
         v != drawing.triangulation.vertices_in_constraint_end(id); ++v) {
      path.push_back(*v);
    }
    if (path.front()->info().number != edge.first) std::reverse(path.begin(), path.end());
  }
}

// Where edges cross each other, or run through corners, exactly.
void find_crossings(Drawing& drawing, const Frame& frame, double height, std::size_t given,
                    CapChanges& changes) {
  for (auto& [edge, path] : drawing.path) {
    for (std::size_t i = 1; i + 1 < path.size(); ++i) {
      auto& number = path[i]->info().number;
      if (number == kNew) {
        number = static_cast<std::uint32_t>(given + changes.created.size());
        const auto& point = path[i]->point();
        changes.created.push_back(
            rounded_to_float(frame.to_part(Vec3(point.x(), point.y(), height))));
      }
      changes.divided[edge].push_back(number);
    }
  }
}

// How often the outlines wind around each face, outside in.
void find_windings(Triangulation& triangulation, const Outline& outline) {
  std::vector<Triangulation::Face_handle> front{triangulation.infinite_face()};
  front.front()->info() = 0;
  while (!front.empty()) {
    const auto face = front.back();
    front.pop_back();
    for (int k = 0; k < 3; ++k) {
      const auto next = face->neighbor(k);
      if (next->info()) continue;
      int winding = *face->info();
      if (face->is_constrained(k)) {
        const auto a = face->vertex(Triangulation::ccw(k))->info().number;
        const auto b = face->vertex(Triangulation::cw(k))->info().number;
        // The face has a -> b on its boundary; leaving it crosses the edge from its left to its
        // right.
        winding -= (a < b ? 1 : -1) * outline.at(undirected(a, b));
      }
      next->info() = winding;
      front.push_back(next);
    }
  }
}

double area_of(Triangulation::Face_handle face) {
  return std::abs(
      CGAL::area(face->vertex(0)->point(), face->vertex(1)->point(), face->vertex(2)->point()));
}

}  // namespace

Caps fill_outline(const std::vector<Vec3>& vertices, const Outline& outline, const Plane& plane,
                  double within_mm) {
  Caps caps;
  if (outline.empty()) return caps;
  const Frame frame = Frame::along(plane.normal);
  const auto sites = sites_of(vertices, outline, frame);
  find_merged(sites, within_mm, caps.changes);
  if (!caps.changes.empty()) return caps;
  std::map<std::uint32_t, Flat> at;
  for (const Site& site : sites) at[site.number] = site.at;
  find_divided(sites, outline, at, within_mm, caps.changes);
  if (!caps.changes.empty()) return caps;
  Drawing drawing;
  draw(drawing, sites, outline);
  find_crossings(drawing, frame, plane.offset, vertices.size(), caps.changes);
  if (!caps.changes.empty()) return caps;
  find_windings(drawing.triangulation, outline);
  for (const auto face : drawing.triangulation.finite_face_handles()) {
    const int winding = *face->info();
    if (winding != 0 && winding != 1) caps.folded_mm2 += area_of(face);
    std::array<std::uint32_t, 3> triangle{};
    for (int k = 0; k < 3; ++k) {
      triangle[static_cast<std::size_t>(k)] = face->vertex(k)->info().number;
    }
    if (winding < 0) std::swap(triangle[1], triangle[2]);
    caps.triangles.insert(caps.triangles.end(), static_cast<std::size_t>(std::abs(winding)),
                          triangle);
  }
  return caps;
}

}  // namespace reforge

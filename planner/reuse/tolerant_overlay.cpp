#include "planner/reuse/tolerant_overlay.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>

#include "planner/geometry/cgal_mesh.h"
#include "planner/geometry/corefine.h"
#include "planner/geometry/mesh_io.h"
#include "planner/geometry/mesh_topology.h"
#include "planner/geometry/triangle_tree.h"
#include "planner/reuse/coincidence.h"

namespace reforge {
namespace {

constexpr double kBalance = 1e-6;  // relative

using Edge = std::array<std::uint32_t, 2>;

// A whole surface, cut where it meets others.
struct Sheet {
  TriangleMesh mesh;
  std::vector<std::uint32_t> origins;  // by triangle, of the surface before the cut
  std::vector<std::uint32_t> patch;    // by triangle: pieces between seams
  std::uint32_t patches = 0;
};

// The triangles of `mesh` that `wanted` marks, all vertices under their numbers.
TriangleMesh some_of(const TriangleMesh& mesh, const std::vector<bool>& wanted,
                     std::vector<std::uint32_t>& numbers) {
  TriangleMesh some;
  some.vertices = mesh.vertices;
  numbers.clear();
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!wanted[t]) continue;
    some.triangles.push_back(mesh.triangles[t]);
    numbers.push_back(t);
  }
  return some;
}

void number_patches(Sheet& sheet, std::vector<Edge> seams) {
  std::sort(seams.begin(), seams.end());
  struct Side {
    Edge edge;
    std::uint32_t triangle;
  };
  std::vector<Side> sides;
  sides.reserve(3 * sheet.mesh.triangles.size());
  for (std::uint32_t t = 0; t < sheet.mesh.triangles.size(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const auto a = sheet.mesh.triangles[t][k], b = sheet.mesh.triangles[t][(k + 1) % 3];
      sides.push_back({{std::min(a, b), std::max(a, b)}, t});
    }
  }
  std::sort(sides.begin(), sides.end(), [](const Side& x, const Side& y) {
    return std::tie(x.edge, x.triangle) < std::tie(y.edge, y.triangle);
  });
  std::vector<std::uint32_t> parent(sheet.mesh.triangles.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root_of = [&parent](std::uint32_t x) {
    while (parent[x] != x) x = parent[x] = parent[parent[x]];
    return x;
  };
  for (std::size_t i = 1; i < sides.size(); ++i) {
    if (sides[i].edge != sides[i - 1].edge) continue;
    if (std::binary_search(seams.begin(), seams.end(), sides[i].edge)) continue;
    const auto a = root_of(sides[i].triangle), b = root_of(sides[i - 1].triangle);
    parent[std::max(a, b)] = std::min(a, b);
  }
  sheet.patch.resize(parent.size());
  for (std::uint32_t t = 0; t < parent.size(); ++t) {
    const auto root = root_of(t);
    sheet.patch[t] = root == t ? sheet.patches++ : sheet.patch[root];
  }
}

// The surface with its cut triangles in place of the given ones.
Sheet whole(const TriangleMesh& mesh, const std::vector<bool>& was_cut, CutSurface cut,
            const std::vector<std::uint32_t>& numbers) {
  Sheet sheet;
  sheet.mesh = std::move(cut.mesh);
  for (const auto origin : cut.origins) sheet.origins.push_back(numbers[origin]);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (was_cut[t]) continue;
    sheet.mesh.triangles.push_back(mesh.triangles[t]);
    sheet.origins.push_back(t);
  }
  number_patches(sheet, std::move(cut.seams));
  return sheet;
}

// Whether each patch lies inside a solid. The widest triangles of a patch are asked, the one
// farthest from the solid's surface decides.
std::vector<bool> inside(const Sheet& sheet, const TriangleTree& solid) {
  struct Candidate {
    double width = -1;
    std::uint32_t triangle = 0;
  };
  constexpr std::size_t kAsked = 4;
  std::vector<std::array<Candidate, kAsked>> widest(sheet.patches);
  const auto& [vertices, triangles] = sheet.mesh;
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    const auto [a, b, c] = triangles[t];
    const double width = (vertices[b] - vertices[a]).cross(vertices[c] - vertices[a]).norm();
    auto& list = widest[sheet.patch[t]];
    if (width <= list.back().width) continue;
    list.back() = {width, t};
    std::stable_sort(list.begin(), list.end(),
                     [](const Candidate& x, const Candidate& y) { return x.width > y.width; });
  }
  std::vector<bool> result(sheet.patches);
  const double far = std::max(1., bounds(solid.mesh()).diagonal().norm());
  for (std::uint32_t p = 0; p < sheet.patches; ++p) {
    Vec3 best = Vec3::Zero();
    double clear = -1;
    for (const Candidate& candidate : widest[p]) {
      if (candidate.width < 0 || clear > 1e-3) break;
      const auto [a, b, c] = triangles[candidate.triangle];
      const Vec3 middle = (vertices[a] + vertices[b] + vertices[c]) / 3;
      const auto near = solid.closest(middle, clear < 0 ? 4 * far : far);
      const double distance = near ? near->distance : far;
      if (distance <= clear) continue;
      clear = distance;
      best = middle;
    }
    result[p] = solid.contains(best);
  }
  return result;
}

struct Sheets {
  Sheet initial, grown, shrunk;  // of `shrunk` only what was moved
};

Result<Sheets> cut_apart(const Separation& separation, const TriangleTree& initial,
                         const TriangleTree& grown, const TriangleTree& shrunk,
                         const std::vector<std::uint32_t>& in_target) {
  std::vector<bool> of_initial(initial.mesh().triangles.size()),
      of_grown(grown.mesh().triangles.size()), of_shrunk(shrunk.mesh().triangles.size());
  TriangleTree::visit_pairs(initial, grown, [&](std::uint32_t i, std::uint32_t j) {
    if (separation.initial_settled[i] && separation.target_settled[j]) return;
    of_initial[i] = of_grown[j] = true;
  });
  TriangleTree::visit_pairs(initial, shrunk, [&](std::uint32_t i, std::uint32_t j) {
    if (separation.initial_settled[i] && separation.target_settled[in_target[j]]) return;
    of_initial[i] = of_shrunk[j] = true;
  });
  std::vector<std::uint32_t> in_initial, in_grown, in_shrunk;
  const TriangleMesh first = some_of(initial.mesh(), of_initial, in_initial);
  const std::vector<TriangleMesh> others{some_of(grown.mesh(), of_grown, in_grown),
                                         some_of(shrunk.mesh(), of_shrunk, in_shrunk)};
  auto cuts = corefine(first, others);
  if (!cuts) return cuts.error();
  return Sheets{whole(initial.mesh(), of_initial, std::move((*cuts)[0]), in_initial),
                whole(grown.mesh(), of_grown, std::move((*cuts)[1]), in_grown),
                whole(shrunk.mesh(), of_shrunk, std::move((*cuts)[2]), in_shrunk)};
}

void add_facet(CellComplex& complex, const Sheet& sheet, std::size_t first_vertex, std::size_t t,
               std::uint8_t front, std::uint8_t back) {
  CellFacet facet;
  for (std::size_t k = 0; k < 3; ++k) {
    facet.corners[k] = static_cast<std::uint32_t>(first_vertex + sheet.mesh.triangles[t][k]);
  }
  facet.front = front;
  facet.back = back;
  complex.facets.push_back(facet);
}

std::size_t add_vertices(CellComplex& complex, const Sheet& sheet) {
  const std::size_t first = complex.vertices.size();
  const TriangleMesh rounded = rounded_to_float(sheet.mesh);
  complex.vertices.insert(complex.vertices.end(), rounded.vertices.begin(), rounded.vertices.end());
  return first;
}

Result<CellComplex> separated_overlay(const TriangleMesh& initial, const Separation& separation) {
  TriangleMesh moved;
  std::vector<std::uint32_t> numbers;
  moved = some_of(separation.shrunk, separation.moved, numbers);
  const TriangleTree tree(initial), grown(separation.grown), shrunk(separation.shrunk),
      moved_tree(moved);
  const auto sheets = cut_apart(separation, tree, grown, moved_tree, numbers);
  if (!sheets) return sheets.error();
  const auto in_grown = inside(sheets->initial, grown);
  const auto in_shrunk = inside(sheets->initial, shrunk);
  const auto grown_in = inside(sheets->grown, tree);
  const auto shrunk_in = inside(sheets->shrunk, tree);
  CellComplex complex;
  auto first = add_vertices(complex, sheets->initial);
  for (std::size_t t = 0; t < sheets->initial.mesh.triangles.size(); ++t) {
    const auto p = sheets->initial.patch[t];
    add_facet(complex, sheets->initial, first, t, in_shrunk[p] ? 2 : 0, in_grown[p] ? 3 : 1);
  }
  first = add_vertices(complex, sheets->grown);
  for (std::size_t t = 0; t < sheets->grown.mesh.triangles.size(); ++t) {
    if (grown_in[sheets->grown.patch[t]]) {
      add_facet(complex, sheets->grown, first, t, 1, 3);
    } else if (!separation.moved[sheets->grown.origins[t]]) {
      add_facet(complex, sheets->grown, first, t, 0, 2);
    }
  }
  first = add_vertices(complex, sheets->shrunk);
  for (std::size_t t = 0; t < sheets->shrunk.mesh.triangles.size(); ++t) {
    if (!shrunk_in[sheets->shrunk.patch[t]]) add_facet(complex, sheets->shrunk, first, t, 0, 2);
  }
  tidy(complex);
  for (std::uint32_t f = 0; f < complex.facets.size(); ++f) complex.facets[f].origin = f;
  return complex;
}

// Why the complex is not a division of the two solids, or nothing.
std::optional<std::string> fault(const TolerantOverlay& result, double initial_volume,
                                 double target_volume, double tolerance_mm) {
  double volumes[4] = {};
  for (std::uint8_t region = 1; region < 4; ++region) {
    if (!is_closed(surface_of(result.complex, 1u << region))) return "their pieces do not close";
    volumes[region] = volume_of(result.complex, region);
    if (volumes[region] < -kBalance * initial_volume) return "a piece is inside out";
  }
  if (std::abs(volumes[1] + volumes[3] - initial_volume) > kBalance * initial_volume) {
    return "the pieces do not add up to the initial part";
  }
  if (std::abs(volumes[2] + volumes[3] - target_volume) >
      kBalance * target_volume + tolerance_mm * result.coincident_area_mm2) {
    return "the pieces do not add up to the target";
  }
  return std::nullopt;
}

}  // namespace

Result<TolerantOverlay> tolerant_overlay(const TriangleMesh& initial, const TriangleMesh& target,
                                         double tolerance_mm) {
  assert(!initial.empty() && !target.empty());
  const Separation separation = separate(initial, target, tolerance_mm);
  const double initial_volume = volume(initial), target_volume = volume(target);
  TolerantOverlay result;
  result.coincident_area_mm2 = separation.coincident_area_mm2;
  result.greatest_distance_mm = separation.greatest_distance_mm;
  auto complex = separated_overlay(initial, separation);
  std::optional<std::string> why;
  if (complex) {
    result.complex = std::move(*complex);
    why = fault(result, initial_volume, target_volume, tolerance_mm);
  }
  if (!complex || why) {
    auto exact = overlay(initial, target);
    if (!exact) return complex ? exact.error() : complex.error();
    result.complex = std::move(*exact);
    why = fault(result, initial_volume, target_volume, tolerance_mm);
    if (why) {
      return Error{Code::kBooleanFailed,
                   "The volumes of the two parts could not be computed: " + *why + "."};
    }
  }
  result.dropped_mm3 = target_volume - volume_of(result.complex, 2) - volume_of(result.complex, 3);
  return result;
}

}  // namespace reforge

#include "planner/reuse/tolerant_overlay.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>

#include "planner/geometry/cgal_mesh.h"
#include "planner/geometry/corefine.h"
#include "planner/geometry/mesh_io.h"
#include "planner/geometry/mesh_topology.h"
#include "planner/geometry/slivers.h"
#include "planner/geometry/triangle_tree.h"
#include "planner/reuse/coincidence.h"

namespace reforge {
namespace {

constexpr double kBalance = 1e-6;  // relative
constexpr double kSliver = 2e-5;   // mm; a few times the rounding to float
constexpr double kSure = 2e-5;     // mm; farther from a surface, its side is beyond doubt

using Edge = std::array<std::uint32_t, 2>;

// A whole surface, cut where it meets others.
struct Sheet {
  TriangleMesh mesh;
  std::vector<std::uint32_t> origins;    // by triangle, of the surface before the cut
  std::vector<std::vector<Edge>> seams;  // by the surface met
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

struct Side {
  Edge edge;
  std::uint32_t corner;  // 3 * triangle + k, where the edge begins
};

// Sorted, so that the sides of one edge stand together.
std::vector<Side> sides_of(const TriangleMesh& mesh) {
  std::vector<Side> sides;
  sides.reserve(3 * mesh.triangles.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::uint32_t k = 0; k < 3; ++k) {
      const auto a = mesh.triangles[t][k], b = mesh.triangles[t][(k + 1) % 3];
      sides.push_back({{std::min(a, b), std::max(a, b)}, 3 * t + k});
    }
  }
  std::sort(sides.begin(), sides.end(), [](const Side& x, const Side& y) {
    return std::tie(x.edge, x.corner) < std::tie(y.edge, y.corner);
  });
  return sides;
}

// Disjoint sets of numbers; the lowest of a set stands for it.
class Sets {
 public:
  explicit Sets(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0u); }
  std::uint32_t root_of(std::uint32_t x) {
    while (parent_[x] != x) x = parent_[x] = parent_[parent_[x]];
    return x;
  }
  void join(std::uint32_t x, std::uint32_t y) {
    const auto a = root_of(x), b = root_of(y);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

// Vertices where the marked triangles touch without an edge between them.
std::vector<bool> pinches(const TriangleMesh& mesh, const std::vector<bool>& marked, bool& any) {
  std::vector<std::uint32_t> numbers;
  const TriangleMesh some = some_of(mesh, marked, numbers);
  const auto sides = sides_of(some);
  Sets fans(3 * some.triangles.size());
  const auto end_of = [](std::uint32_t c) { return c % 3 == 2 ? c - 2 : c + 1; };
  for (std::size_t i = 1; i < sides.size(); ++i) {
    if (sides[i].edge != sides[i - 1].edge) continue;
    fans.join(sides[i].corner, end_of(sides[i - 1].corner));
    fans.join(end_of(sides[i].corner), sides[i - 1].corner);
  }
  constexpr auto kNone = static_cast<std::uint32_t>(-1);
  std::vector<std::uint32_t> fan(mesh.vertices.size(), kNone);
  std::vector<bool> pinched(mesh.vertices.size(), false);
  any = false;
  for (std::uint32_t c = 0; c < 3 * some.triangles.size(); ++c) {
    auto& known = fan[some.triangles[c / 3][c % 3]];
    if (known == kNone) known = fans.root_of(c);
    if (known != fans.root_of(c)) any = pinched[some.triangles[c / 3][c % 3]] = true;
  }
  return pinched;
}

// Marks more triangles, until those around every vertex form one fan.
void unpinch(const TriangleMesh& mesh, std::vector<bool>& marked) {
  for (bool any = true; any;) {
    const auto pinched = pinches(mesh, marked, any);
    if (!any) return;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      for (const auto v : mesh.triangles[t]) marked[t] = marked[t] || pinched[v];
    }
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
  sheet.seams = std::move(cut.seams);
  return sheet;
}

// The pieces of a surface between its seams with one other.
struct Patches {
  std::vector<std::uint32_t> of;  // by triangle
  std::uint32_t count = 0;
  std::vector<Edge> neighbours;  // patches on the two sides of a seam
};

Patches patches_between(const TriangleMesh& mesh, std::vector<Edge> seams) {
  std::sort(seams.begin(), seams.end());
  const auto sides = sides_of(mesh);
  Sets pieces(mesh.triangles.size());
  std::vector<Edge> across;  // triangles on the two sides of a seam
  for (std::size_t i = 1; i < sides.size(); ++i) {
    if (sides[i].edge != sides[i - 1].edge) continue;
    const auto s = sides[i - 1].corner / 3, t = sides[i].corner / 3;
    if (std::binary_search(seams.begin(), seams.end(), sides[i].edge)) {
      across.push_back({s, t});
    } else {
      pieces.join(s, t);
    }
  }
  Patches patches;
  patches.of.resize(mesh.triangles.size());
  for (std::uint32_t t = 0; t < patches.of.size(); ++t) {
    const auto root = pieces.root_of(t);
    patches.of[t] = root == t ? patches.count++ : patches.of[root];
  }
  for (const auto& [s, t] : across) {
    if (patches.of[s] != patches.of[t])
      patches.neighbours.push_back({patches.of[s], patches.of[t]});
  }
  return patches;
}

// A point of a patch that is well inside or well outside of a solid.
struct Witness {
  Vec3 point = Vec3::Zero();
  double clear = -1;  // distance from the solid's surface, mm
};

// The widest triangles of each patch are looked at.
std::vector<Witness> witnesses(const TriangleMesh& mesh, const Patches& patches,
                               const TriangleTree& solid) {
  struct Candidate {
    double width = -1;
    std::uint32_t triangle = 0;
  };
  constexpr std::size_t kAsked = 4;
  std::vector<std::array<Candidate, kAsked>> widest(patches.count);
  const auto& [vertices, triangles] = mesh;
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    const auto [a, b, c] = triangles[t];
    const double width = (vertices[b] - vertices[a]).cross(vertices[c] - vertices[a]).norm();
    auto& list = widest[patches.of[t]];
    if (width <= list.back().width) continue;
    list.back() = {width, t};
    std::stable_sort(list.begin(), list.end(),
                     [](const Candidate& x, const Candidate& y) { return x.width > y.width; });
  }
  std::vector<Witness> found(patches.count);
  for (std::uint32_t p = 0; p < patches.count; ++p) {
    for (const Candidate& candidate : widest[p]) {
      if (candidate.width < 0 || found[p].clear >= kSure) break;
      const auto [a, b, c] = triangles[candidate.triangle];
      const Vec3 middle = (vertices[a] + vertices[b] + vertices[c]) / 3;
      const auto near = solid.closest(middle, kSure);
      const double clear = near ? near->distance : kSure;
      if (clear > found[p].clear) found[p] = {middle, clear};
    }
  }
  return found;
}

// By triangle: whether it lies inside a solid. Two patches along a seam lie on different sides of
// the solid's surface, so a patch too narrow to be asked itself goes by its neighbours.
std::vector<bool> inside(const TriangleMesh& mesh, const std::vector<Edge>& seams,
                         const TriangleTree& solid) {
  const Patches patches = patches_between(mesh, seams);
  const auto witness = witnesses(mesh, patches, solid);
  std::vector<std::vector<std::uint32_t>> beside(patches.count);
  for (const auto& [p, q] : patches.neighbours) {
    beside[p].push_back(q);
    beside[q].push_back(p);
  }
  std::vector<std::uint32_t> by_clearness(patches.count);
  std::iota(by_clearness.begin(), by_clearness.end(), 0u);
  std::stable_sort(by_clearness.begin(), by_clearness.end(), [&](std::uint32_t p, std::uint32_t q) {
    return witness[p].clear > witness[q].clear;
  });
  enum : std::uint8_t { kUnknown, kIn, kOut };
  std::vector<std::uint8_t> is(patches.count, kUnknown);
  std::vector<std::uint32_t> open;
  const auto settle = [&](std::uint32_t p, bool in) {
    is[p] = in ? kIn : kOut;
    open.push_back(p);
  };
  for (const auto p : by_clearness) {
    if (witness[p].clear >= kSure) settle(p, solid.contains(witness[p].point));
  }
  for (std::size_t next = 0, done = 0;; ++next) {
    for (; done < open.size(); ++done) {
      for (const auto q : beside[open[done]]) {
        if (is[q] == kUnknown) settle(q, is[open[done]] == kOut);
      }
    }
    while (next < by_clearness.size() && is[by_clearness[next]] != kUnknown) ++next;
    if (next >= by_clearness.size()) break;
    const auto p = by_clearness[next];
    settle(p, solid.contains(witness[p].point));
  }
  std::vector<bool> result(mesh.triangles.size());
  for (std::size_t t = 0; t < result.size(); ++t) result[t] = is[patches.of[t]] == kIn;
  return result;
}

struct Sheets {
  Sheet initial, grown, shrunk;  // of `shrunk` only what was moved
};

// Marks the triangles of both that cross. Where both are settled a crossing is no true one, unless
// it goes on from a true one.
void mark_crossings(const TriangleTree& initial, const std::vector<bool>& initial_settled,
                    const TriangleTree& target, const std::vector<bool>& target_settled,
                    std::vector<bool>& of_initial, std::vector<bool>& of_target) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> doubtful;
  std::vector<bool> at_initial(initial.mesh().vertices.size()),
      at_target(target.mesh().vertices.size());  // corners of crossing triangles
  const auto mark = [&](std::uint32_t i, std::uint32_t j) {
    of_initial[i] = of_target[j] = true;
    for (const auto v : initial.mesh().triangles[i]) at_initial[v] = true;
    for (const auto v : target.mesh().triangles[j]) at_target[v] = true;
  };
  TriangleTree::visit_pairs(initial, target, [&](std::uint32_t i, std::uint32_t j) {
    if (initial_settled[i] && target_settled[j]) {
      doubtful.emplace_back(i, j);
    } else {
      mark(i, j);
    }
  });
  const auto touches = [](const std::vector<bool>& at,
                          const std::array<std::uint32_t, 3>& corners) {
    return at[corners[0]] || at[corners[1]] || at[corners[2]];
  };
  for (bool more = true; more;) {
    more = false;
    for (auto& [i, j] : doubtful) {
      if (of_initial[i] && of_target[j]) continue;
      if (!touches(at_initial, initial.mesh().triangles[i]) ||
          !touches(at_target, target.mesh().triangles[j])) {
        continue;
      }
      mark(i, j);
      more = true;
    }
  }
}

Result<Sheets> cut_apart(const Separation& separation, const TriangleTree& initial,
                         const TriangleTree& grown, const TriangleTree& shrunk,
                         const std::vector<std::uint32_t>& in_target) {
  std::vector<bool> of_initial(initial.mesh().triangles.size()),
      of_grown(grown.mesh().triangles.size()), of_shrunk(shrunk.mesh().triangles.size());
  mark_crossings(initial, separation.initial_settled, grown, separation.target_settled, of_initial,
                 of_grown);
  std::vector<bool> shrunk_settled;
  for (const auto t : in_target) shrunk_settled.push_back(separation.target_settled[t]);
  mark_crossings(initial, separation.initial_settled, shrunk, shrunk_settled, of_initial,
                 of_shrunk);
  unpinch(initial.mesh(), of_initial);
  unpinch(grown.mesh(), of_grown);
  unpinch(shrunk.mesh(), of_shrunk);
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

// The initial surface's seams with all of the shrunk target: with what was moved, and with what it
// shares with the grown one.
std::vector<Edge> seams_with_shrunk(const Sheets& sheets, const std::vector<bool>& moved) {
  const Sheet& grown = sheets.grown;
  std::vector<Edge> shared;  // edges of triangles that stayed where they were
  for (std::size_t t = 0; t < grown.mesh.triangles.size(); ++t) {
    if (moved[grown.origins[t]]) continue;
    for (int k = 0; k < 3; ++k) {
      const auto a = grown.mesh.triangles[t][k], b = grown.mesh.triangles[t][(k + 1) % 3];
      shared.push_back({std::min(a, b), std::max(a, b)});
    }
  }
  std::sort(shared.begin(), shared.end());
  std::vector<Edge> seams = sheets.initial.seams[1];
  // A seam has the same place in the lists of both its surfaces.
  for (std::size_t i = 0; i < grown.seams[0].size(); ++i) {
    if (std::binary_search(shared.begin(), shared.end(), grown.seams[0][i])) {
      seams.push_back(sheets.initial.seams[0][i]);
    }
  }
  return seams;
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

// Which vertices of the complex are vertices of one of the two parts, unmoved.
std::vector<bool> given_vertices(const CellComplex& complex, const TriangleMesh& initial,
                                 const TriangleMesh& target) {
  const auto before = [](const Vec3& a, const Vec3& b) {
    return std::tie(a.x(), a.y(), a.z()) < std::tie(b.x(), b.y(), b.z());
  };
  std::vector<Vec3> given;
  for (const TriangleMesh* mesh : {&initial, &target}) {
    for (const Vec3& vertex : mesh->vertices) given.push_back(rounded_to_float(vertex));
  }
  std::sort(given.begin(), given.end(), before);
  std::vector<bool> result(complex.vertices.size());
  for (std::size_t v = 0; v < result.size(); ++v) {
    result[v] = std::binary_search(given.begin(), given.end(), complex.vertices[v], before);
  }
  return result;
}

Result<CellComplex> separated_overlay(const TriangleMesh& initial, const Separation& separation) {
  // Triangles that the two versions of the target do not share.
  std::vector<bool> moved = separation.moved;
  unpinch(separation.shrunk, moved);
  std::vector<std::uint32_t> numbers;
  const TriangleMesh moved_mesh = some_of(separation.shrunk, moved, numbers);
  const TriangleTree tree(initial), grown(separation.grown), shrunk(separation.shrunk),
      moved_tree(moved_mesh);
  const auto sheets = cut_apart(separation, tree, grown, moved_tree, numbers);
  if (!sheets) return sheets.error();
  const auto& [first, second, third] = *sheets;
  const auto in_grown = inside(first.mesh, first.seams[0], grown);
  const auto in_shrunk = inside(first.mesh, seams_with_shrunk(*sheets, moved), shrunk);
  const auto grown_in = inside(second.mesh, second.seams[0], tree);
  const auto shrunk_in = inside(third.mesh, third.seams[0], tree);
  CellComplex complex;
  auto from = add_vertices(complex, first);
  for (std::size_t t = 0; t < first.mesh.triangles.size(); ++t) {
    add_facet(complex, first, from, t, in_shrunk[t] ? 2 : 0, in_grown[t] ? 3 : 1);
  }
  from = add_vertices(complex, second);
  for (std::size_t t = 0; t < second.mesh.triangles.size(); ++t) {
    if (grown_in[t]) {
      add_facet(complex, second, from, t, 1, 3);
    } else if (!moved[second.origins[t]]) {
      add_facet(complex, second, from, t, 0, 2);
    }
  }
  from = add_vertices(complex, third);
  for (std::size_t t = 0; t < third.mesh.triangles.size(); ++t) {
    if (!shrunk_in[t]) add_facet(complex, third, from, t, 0, 2);
  }
  tidy(complex);
  remove_slivers(complex, given_vertices(complex, initial, separation.target), kSliver);
  for (std::uint32_t f = 0; f < complex.facets.size(); ++f) complex.facets[f].origin = f;
  return complex;
}

// Why the complex is not a division of the two solids, or nothing.
std::optional<std::string> fault(TolerantOverlay& result, const TriangleMesh& initial,
                                 const TriangleMesh& target, double tolerance_mm) {
  const double of_initial = volume(initial), of_target = volume(target);
  double volumes[4] = {};
  for (std::uint8_t region = 1; region < 4; ++region) {
    const TriangleMesh surface = surface_of(result.complex, 1u << region);
    if (!is_closed(surface)) return "their pieces do not close";
    volumes[region] = volume(surface);
    if (volumes[region] < -kBalance * of_initial) return "a piece is inside out";
  }
  if (std::abs(volumes[1] + volumes[3] - of_initial) > kBalance * of_initial) {
    return "the pieces do not add up to the initial part";
  }
  result.dropped_mm3 = of_target - volumes[2] - volumes[3];
  if (std::abs(result.dropped_mm3) >
      kBalance * of_target + tolerance_mm * result.coincident_area_mm2) {
    return "the pieces do not add up to the target";
  }
  return std::nullopt;
}

Result<TolerantOverlay> attempt(const TriangleMesh& initial, const TriangleMesh& target,
                                double tolerance_mm) {
  const Separation separation = separate(initial, target, tolerance_mm);
  auto complex = separated_overlay(initial, separation);
  if (!complex) return complex.error();
  TolerantOverlay result;
  result.complex = std::move(*complex);
  result.coincident_area_mm2 = separation.coincident_area_mm2;
  result.greatest_distance_mm = separation.greatest_distance_mm;
  if (const auto why = fault(result, initial, target, tolerance_mm)) {
    return Error{Code::kBooleanFailed,
                 "The volumes of the two parts could not be computed: " + *why + "."};
  }
  return result;
}

}  // namespace

Result<TolerantOverlay> tolerant_overlay(const TriangleMesh& initial, const TriangleMesh& target,
                                         double tolerance_mm) {
  assert(!initial.empty() && !target.empty());
  std::optional<Error> last;
  // Where parts are finer than the hair, a finer hair may do.
  for (const double tolerance : {tolerance_mm, tolerance_mm / 4, tolerance_mm / 16}) {
    auto result = attempt(initial, target, tolerance);
    if (result) return result;
    last = result.error();
  }
  auto exact = overlay(initial, target);
  if (!exact) return exact.error();
  TolerantOverlay result;
  result.complex = std::move(*exact);
  if (const auto why = fault(result, initial, target, tolerance_mm)) return *last;
  return result;
}

}  // namespace reforge

// Symbols: s signed distance of a vertex from the plane; far facets have a corner with s > 0 and
// none with s < 0 once every edge through the plane has been split; R the region being cut.
#include "planner/geometry/plane_cut.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <optional>

#include "planner/geometry/mesh_io.h"
#include "planner/geometry/mesh_topology.h"
#include "planner/geometry/plane_caps.h"

namespace reforge {
namespace {

constexpr double kOnPlane = 1e-5;             // mm, at least
constexpr double kRounding = 1. / (1 << 22);  // of the largest coordinate: more than float's
constexpr int kPasses = 16;                   // until outlines lie on each other or apart
constexpr int kAttempts = 6;
constexpr double kStep = 4e-5;   // mm between attempts
constexpr double kClean = 1e-6;  // mm^2 of folded caps that nobody minds

using Triple = std::array<std::uint32_t, 3>;
UndirectedEdge undirected(std::uint32_t a, std::uint32_t b) {
  return {std::min(a, b), std::max(a, b)};
}

// What a cut adds to a complex before it is known which pieces are taken.
struct Split {
  CellComplex complex;
  std::vector<double> distance;    // by vertex; on the plane exactly 0
  std::vector<std::uint32_t> far;  // facets of R beyond the plane
  std::vector<Triple> caps;        // counter-clockwise seen from the far side
  double folded_mm2 = 0;           // of them
};

bool borders(const CellFacet& facet, std::uint8_t region) {
  return facet.front == region || facet.back == region;
}

// Splits every edge of R's surface that passes through the plane, in all facets that have it.
void split_edges(Split& split, std::uint8_t region) {
  CellComplex& complex = split.complex;
  std::vector<double>& s = split.distance;
  std::map<UndirectedEdge, std::uint32_t> middle;
  for (const CellFacet& facet : complex.facets) {
    if (!borders(facet, region)) continue;
    for (int k = 0; k < 3; ++k) {
      const auto [a, b] = undirected(facet.corners[k], facet.corners[(k + 1) % 3]);
      if (s[a] * s[b] >= 0) continue;
      const auto [entry, is_new] =
          middle.try_emplace({a, b}, static_cast<std::uint32_t>(complex.vertices.size()));
      if (!is_new) continue;
      const double t = s[a] / (s[a] - s[b]);
      const Vec3 point = complex.vertices[a] + t * (complex.vertices[b] - complex.vertices[a]);
      complex.vertices.push_back(rounded_to_float(point));
      s.push_back(0);
    }
  }
  std::vector<CellFacet> facets;
  facets.reserve(complex.facets.size() + 3 * middle.size());
  for (CellFacet facet : complex.facets) {
    // Rotate so that the split edges come last, then cut corners off.
    std::array<std::optional<std::uint32_t>, 3> on_edge;  // k: edge from corner k to k + 1
    const auto look_up = [&] {
      for (int k = 0; k < 3; ++k) {
        const auto found = middle.find(undirected(facet.corners[k], facet.corners[(k + 1) % 3]));
        on_edge[k] = found == middle.end() ? std::nullopt : std::optional(found->second);
      }
    };
    look_up();
    for (int turn = 0;
         turn < 2 && (on_edge[0] || !on_edge[2]) && (on_edge[0] || on_edge[1] || on_edge[2]);
         ++turn) {
      std::rotate(facet.corners.begin(), facet.corners.begin() + 1, facet.corners.end());
      look_up();
    }
    const auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      CellFacet part = facet;
      part.corners = {a, b, c};
      facets.push_back(part);
    };
    const auto [a, b, c] = facet.corners;
    if (on_edge[1] && on_edge[2]) {  // corner c is alone on its side
      add(*on_edge[2], *on_edge[1], c);
      add(a, b, *on_edge[1]);
      add(a, *on_edge[1], *on_edge[2]);
    } else if (on_edge[2]) {
      add(a, b, *on_edge[2]);
      add(*on_edge[2], b, c);
    } else {
      facets.push_back(facet);
    }
  }
  complex.facets = std::move(facets);
}

void find_far(Split& split, const Plane& plane, std::uint8_t region) {
  split.far.clear();
  for (std::uint32_t f = 0; f < split.complex.facets.size(); ++f) {
    const CellFacet& facet = split.complex.facets[f];
    if (!borders(facet, region)) continue;
    const auto& [a, b, c] = facet.corners;
    const double highest = std::max({split.distance[a], split.distance[b], split.distance[c]});
    const double lowest = std::min({split.distance[a], split.distance[b], split.distance[c]});
    bool is_far = highest > 0;
    if (highest == 0 && lowest == 0) {
      // Lies in the plane: R is beyond it if R is where the normal points.
      const auto& v = split.complex.vertices;
      const bool faces_far = (v[b] - v[a]).cross(v[c] - v[a]).dot(plane.normal) > 0;
      is_far = (facet.front == region) == faces_far;
    }
    if (is_far) split.far.push_back(f);
  }
}

// What R's surface beyond the plane leaves open.
Outline outline_of(const Split& split, std::uint8_t region) {
  Outline outline;
  for (const auto f : split.far) {
    const CellFacet& facet = split.complex.facets[f];
    for (int k = 0; k < 3; ++k) {
      auto a = facet.corners[k], b = facet.corners[(k + 1) % 3];
      if (split.distance[a] != 0 || split.distance[b] != 0) continue;
      if (facet.front == region) std::swap(a, b);
      // The caps seen from the far side run along the far facets' own edges: R's surface beyond
      // the plane, seen from outside, has the cap on its left where it ends.
      outline[undirected(a, b)] += a < b ? 1 : -1;
    }
  }
  std::erase_if(outline, [](const auto& entry) { return entry.second == 0; });
  return outline;
}

// The vertices between the corners of a facet, by edge, in the order of its corners.
using Between = std::array<std::vector<std::uint32_t>, 3>;

void add_divided(std::vector<CellFacet>& facets, const CellFacet& facet, Between between) {
  const auto& [a, b, c] = facet.corners;
  if (a == b || b == c || c == a) return;
  const auto longest = std::max_element(between.begin(), between.end(),
                                        [](auto& x, auto& y) { return x.size() < y.size(); });
  if (longest->empty()) {
    facets.push_back(facet);
    return;
  }
  const auto k = static_cast<std::size_t>(longest - between.begin());
  const auto middle = longest->begin() + static_cast<std::ptrdiff_t>(longest->size() / 2);
  const auto from = facet.corners[k], to = facet.corners[(k + 1) % 3],
             apex = facet.corners[(k + 2) % 3];
  CellFacet half = facet;
  half.corners = {from, *middle, apex};
  add_divided(facets, half, {std::vector(longest->begin(), middle), {}, between[(k + 2) % 3]});
  half.corners = {*middle, to, apex};
  add_divided(facets, half, {std::vector(middle + 1, longest->end()), between[(k + 1) % 3], {}});
}

// Every step maps edges to what replaces them in all facets alike, so regions stay closed.
void apply(CellComplex& complex, const CapChanges& changes) {
  complex.vertices.insert(complex.vertices.end(), changes.created.begin(), changes.created.end());
  std::vector<CellFacet> facets;
  facets.reserve(complex.facets.size());
  for (CellFacet facet : complex.facets) {
    Between between;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto a = facet.corners[k], b = facet.corners[(k + 1) % 3];
      const auto found = changes.divided.find(undirected(a, b));
      if (found == changes.divided.end()) continue;
      between[k] = found->second;
      if (a > b) std::reverse(between[k].begin(), between[k].end());
    }
    for (auto& corner : facet.corners) {
      const auto found = changes.merged.find(corner);
      if (found != changes.merged.end()) corner = found->second;
    }
    add_divided(facets, facet, std::move(between));
  }
  complex.facets = std::move(facets);
  tidy(complex);
}

void measure(Split& split, const Plane& plane, double on_plane) {
  split.distance.clear();
  for (const Vec3& vertex : split.complex.vertices) {
    const double distance = plane.signed_distance(vertex);
    split.distance.push_back(std::abs(distance) < on_plane ? 0 : distance);
  }
}

// Splits and caps; nothing when the outlines do not come to rest.
std::optional<Split> try_split(const CellComplex& complex, const Plane& plane,
                               std::uint8_t region) {
  double size = 0;
  for (const Vec3& vertex : complex.vertices) {
    size = std::max(size, vertex.lpNorm<Eigen::Infinity>());
  }
  const double on_plane = std::max(kOnPlane, size * kRounding);
  Split split{complex, {}, {}, {}, 0};
  measure(split, plane, on_plane);
  split_edges(split, region);
  tidy(split.complex);  // rounding may have brought vertices together
  for (int pass = 0; pass < kPasses; ++pass) {
    measure(split, plane, on_plane);
    find_far(split, plane, region);
    Caps caps = fill_outline(split.complex.vertices, outline_of(split, region), plane, on_plane);
    if (caps.changes.empty()) {
      split.caps = std::move(caps.triangles);
      split.folded_mm2 = caps.folded_mm2;
      return split;
    }
    apply(split.complex, caps.changes);
  }
  return std::nullopt;
}

// The far facets (numbers below far.size()) and caps (above) of each connected piece.
std::vector<std::vector<std::size_t>> connected(const Split& split) {
  const std::size_t count = split.far.size() + split.caps.size();
  TriangleMesh surface;
  surface.vertices = split.complex.vertices;
  for (const auto f : split.far) surface.triangles.push_back(split.complex.facets[f].corners);
  for (const Triple& cap : split.caps) surface.triangles.push_back(cap);
  std::uint32_t pieces_found = 0;
  const auto piece = pieces(surface, pieces_found);
  std::vector<std::vector<std::size_t>> members(pieces_found);
  for (std::size_t i = 0; i < count; ++i) members[piece[i]].push_back(i);
  return members;
}

FarPiece far_piece(const Split& split, const std::vector<std::size_t>& members,
                   std::uint8_t region) {
  FarPiece piece;
  piece.surface.vertices = split.complex.vertices;
  for (const std::size_t member : members) {
    const bool is_cap = member >= split.far.size();
    Triple t = is_cap ? split.caps[member - split.far.size()]
                      : split.complex.facets[split.far[member]].corners;
    // Outward: caps look to the near side, facets away from R.
    if (is_cap || split.complex.facets[split.far[member]].front == region) std::swap(t[1], t[2]);
    piece.surface.triangles.push_back(t);
    if (!is_cap) piece.origins.push_back(split.complex.facets[split.far[member]].origin);
  }
  piece.surface = welded(piece.surface);
  return piece;
}

// Shells that enclose a hollow go with the piece around it.
void join_hollows(std::vector<std::vector<std::size_t>>& members, std::vector<FarPiece>& found) {
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (volume(found[i].surface) >= 0) continue;
    for (std::size_t j = 0; j < found.size(); ++j) {
      if (i == j || volume(found[j].surface) <= 0) continue;
      if (!contains(found[j].surface, found[i].surface.vertices.front())) continue;
      members[j].insert(members[j].end(), members[i].begin(), members[i].end());
      found[j].surface = joined(found[j].surface, found[i].surface);
      found[j].origins.insert(found[j].origins.end(), found[i].origins.begin(),
                              found[i].origins.end());
      members[i].clear();
      break;
    }
  }
}

void take_pieces(Split& split, std::uint8_t region, std::uint8_t becomes, std::uint32_t mark,
                 const std::function<bool(const FarPiece&)>& take) {
  auto members = connected(split);
  std::vector<FarPiece> found;
  for (const auto& piece : members) found.push_back(far_piece(split, piece, region));
  join_hollows(members, found);
  for (std::size_t p = 0; p < members.size(); ++p) {
    if (members[p].empty() || !take(found[p])) continue;
    for (const std::size_t member : members[p]) {
      if (member < split.far.size()) {
        CellFacet& facet = split.complex.facets[split.far[member]];
        (facet.front == region ? facet.front : facet.back) = becomes;
      } else {
        const Triple& cap = split.caps[member - split.far.size()];
        split.complex.facets.push_back({cap, becomes, region, 0, mark});
      }
    }
  }
  tidy(split.complex);
}

}  // namespace

Result<Plane> cut_off(CellComplex& complex, const Plane& plane, std::uint8_t region,
                      std::uint8_t becomes, std::uint32_t mark,
                      const std::function<bool(const FarPiece&)>& take) {
  assert(region != becomes);
  std::optional<Split> best;
  Plane used = plane;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    Plane moved = plane;
    moved.offset -= attempt * kStep;
    auto split = try_split(complex, moved, region);
    if (!split || (best && best->folded_mm2 <= split->folded_mm2)) continue;
    best = std::move(split);
    used = moved;
    if (best->folded_mm2 < kClean) break;
  }
  if (!best) {
    return Error{
        Code::kBooleanFailed,
        "A volume could not be cut by a clipping plane: its outline there does not come to "
        "rest."};
  }
  take_pieces(*best, region, becomes, mark, take);
  if (!is_closed(surface_of(best->complex, 1u << region)) ||
      !is_closed(surface_of(best->complex, 1u << becomes))) {
    return Error{Code::kBooleanFailed,
                 "A volume could not be cut by a clipping plane: it is not closed."};
  }
  complex = std::move(best->complex);
  return used;
}

Result<std::pair<TriangleMesh, TriangleMesh>> split_by(const TriangleMesh& solid,
                                                       const Plane& plane) {
  CellComplex complex;
  complex.vertices = solid.vertices;
  for (std::uint32_t t = 0; t < solid.triangles.size(); ++t) {
    complex.facets.push_back({solid.triangles[t], 0, 1, t, 0});
  }
  tidy(complex);
  const auto used = cut_off(complex, plane, 1, 2, 1, [](const FarPiece&) { return true; });
  if (!used) return used.error();
  return std::pair{surface_of(complex, 1u << 1), surface_of(complex, 1u << 2)};
}

}  // namespace reforge

#include "planner/geometry/slivers.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <tuple>

namespace reforge {
namespace {

constexpr int kRounds = 64;

using Edge = std::array<std::uint32_t, 2>;

Edge sorted(std::uint32_t a, std::uint32_t b) {
  return {std::min(a, b), std::max(a, b)};
}

// One facet's defect: an edge to draw together, or a vertex to put on an edge.
struct Defect {
  double size = 0;
  Edge edge{};
  std::uint32_t vertex = 0;
  bool is_edge = false;
};

class Round {
 public:
  Round(CellComplex& complex, const std::vector<bool>& given, double within)
      : complex_(complex), given_(given), within_(within), busy_(complex.vertices.size(), false) {}

  // Whether anything was done. One change at most at every vertex.
  bool run() {
    std::vector<Defect> defects;
    for (const CellFacet& facet : complex_.facets) find(facet, defects);
    std::sort(defects.begin(), defects.end(), [](const Defect& x, const Defect& y) {
      if (x.is_edge != y.is_edge) return x.is_edge;  // short edges first: they take needles along
      return std::tie(x.size, x.edge, x.vertex) < std::tie(y.size, y.edge, y.vertex);
    });
    note_facets_around(defects);
    std::vector<std::uint32_t> becomes(complex_.vertices.size());
    std::iota(becomes.begin(), becomes.end(), 0u);
    std::map<Edge, std::uint32_t> divide;
    bool any = false;
    for (const Defect& defect : defects) {
      const auto [a, b] = defect.edge;
      if (busy_[a] || busy_[b] || (!defect.is_edge && busy_[defect.vertex])) continue;
      if (!defect.is_edge && !improves(defect)) continue;
      busy_[a] = busy_[b] = any = true;
      if (defect.is_edge) {
        if (given_[b]) {
          becomes[a] = b;
        } else {
          becomes[b] = a;
        }
      } else {
        busy_[defect.vertex] = true;
        divide[defect.edge] = defect.vertex;
      }
    }
    if (any) apply(becomes, divide);
    return any;
  }

 private:
  double height(std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
    const Vec3 &p = complex_.vertices[a], &q = complex_.vertices[b], &r = complex_.vertices[c];
    const double longest = std::max({(q - p).norm(), (r - q).norm(), (p - r).norm()});
    return longest > 0 ? (q - p).cross(r - p).norm() / longest : 0;
  }

  void note_facets_around(const std::vector<Defect>& defects) {
    for (const Defect& defect : defects) {
      if (!defect.is_edge) around_[defect.edge];
    }
    for (const CellFacet& facet : complex_.facets) {
      for (std::size_t k = 0; k < 3; ++k) {
        const auto found = around_.find(sorted(facet.corners[k], facet.corners[(k + 1) % 3]));
        if (found != around_.end()) found->second.push_back(facet.corners[(k + 2) % 3]);
      }
    }
  }

  // Whether dividing the needle's long edge leaves wider facets than the needle was; else needles
  // side by side would take turns for ever.
  bool improves(const Defect& needle) const {
    const auto [a, b] = needle.edge;
    const auto& apexes = around_.at(needle.edge);
    return std::all_of(apexes.begin(), apexes.end(), [&, b_ = b, a_ = a](std::uint32_t w) {
      if (w == needle.vertex) return true;
      return std::min(height(a_, needle.vertex, w), height(needle.vertex, b_, w)) >
             1.01 * needle.size;
    });
  }

  void find(const CellFacet& facet, std::vector<Defect>& defects) const {
    const auto& v = complex_.vertices;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto a = facet.corners[k], b = facet.corners[(k + 1) % 3];
      const double length = (v[a] - v[b]).norm();
      if (length < within_ && !(given_[a] && given_[b])) {
        defects.push_back({length, sorted(a, b), 0, true});
      }
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const auto a = facet.corners[k], b = facet.corners[(k + 1) % 3],
                 c = facet.corners[(k + 2) % 3];
      const Vec3 along = v[b] - v[a];
      const double way = (v[c] - v[a]).dot(along) / along.squaredNorm();
      if (!(way > 0 && way < 1)) continue;
      const double height = (v[c] - v[a] - way * along).norm();
      if (height < within_ && !(given_[a] && given_[b] && given_[c])) {
        defects.push_back({height, sorted(a, b), c, false});
      }
    }
  }

  void apply(const std::vector<std::uint32_t>& becomes,
             const std::map<Edge, std::uint32_t>& divide) {
    const auto facets = std::move(complex_.facets);
    complex_.facets.clear();
    for (CellFacet facet : facets) {
      for (auto& corner : facet.corners) corner = becomes[corner];
      add(facet, divide);
    }
  }

  // Adds a facet, divided where one of its edges is.
  void add(const CellFacet& facet, const std::map<Edge, std::uint32_t>& divide) {
    const auto& [i, j, l] = facet.corners;
    if (i == j || j == l || l == i) return;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto a = facet.corners[k], b = facet.corners[(k + 1) % 3],
                 c = facet.corners[(k + 2) % 3];
      const auto found = divide.find(sorted(a, b));
      if (found == divide.end()) continue;
      if (found->second == c) return;  // the needle itself: nothing is left of it
      CellFacet half = facet;
      half.corners = {a, found->second, c};
      add(half, divide);
      half.corners = {found->second, b, c};
      add(half, divide);
      return;
    }
    complex_.facets.push_back(facet);
  }

  CellComplex& complex_;
  const std::vector<bool>& given_;
  double within_;
  std::vector<bool> busy_;
  std::map<Edge, std::vector<std::uint32_t>> around_;  // third corners of the facets at an edge
};

}  // namespace

void remove_slivers(CellComplex& complex, const std::vector<bool>& given, double within_mm) {
  for (int round = 0; round < kRounds; ++round) {
    if (!Round(complex, given, within_mm).run()) break;
  }
  tidy(complex);
}

}  // namespace reforge

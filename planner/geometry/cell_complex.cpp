#include "planner/geometry/cell_complex.h"

#include <algorithm>
#include <cassert>
#include <map>

#include "planner/geometry/mesh_parsers.h"
#include "planner/geometry/mesh_topology.h"

namespace reforge {
namespace {

using Triple = std::array<std::uint32_t, 3>;

bool is_even_permutation(const Triple& t) {
  return (t[0] < t[1]) + (t[1] < t[2]) + (t[2] < t[0]) == 2;
}

// The lowest corner first and the corners ascending as a cycle, so that twins compare equal.
CellFacet normalised(CellFacet facet) {
  if (!is_even_permutation(facet.corners)) {
    std::swap(facet.corners[1], facet.corners[2]);
    std::swap(facet.front, facet.back);
  }
  std::rotate(facet.corners.begin(), std::min_element(facet.corners.begin(), facet.corners.end()),
              facet.corners.end());
  return facet;
}

// Facets stacked on each other: what is behind one is in front of the next, and nothing in between.
void collapse_stack(std::vector<CellFacet>& stack) {
  for (bool joined = true; joined && stack.size() > 1;) {
    joined = false;
    for (std::size_t i = 0; i < stack.size() && !joined; ++i) {
      for (std::size_t j = 0; j < stack.size() && !joined; ++j) {
        if (i == j || stack[i].back != stack[j].front) continue;
        stack[i].back = stack[j].back;
        stack.erase(stack.begin() + static_cast<std::ptrdiff_t>(j));
        joined = true;
      }
    }
  }
}

}  // namespace

TriangleMesh surface_of(const CellComplex& complex, unsigned regions,
                        std::vector<std::uint32_t>* facets) {
  TriangleMesh mesh;
  mesh.vertices = complex.vertices;
  if (facets) facets->clear();
  for (std::uint32_t f = 0; f < complex.facets.size(); ++f) {
    const CellFacet& facet = complex.facets[f];
    const bool in_front = regions >> facet.front & 1, behind = regions >> facet.back & 1;
    if (in_front == behind) continue;
    auto [a, b, c] = facet.corners;
    if (in_front) std::swap(b, c);
    mesh.triangles.push_back({a, b, c});
    if (facets) facets->push_back(f);
  }
  return welded(mesh);  // distinct vertices: only drops the unused ones
}

double volume_of(const CellComplex& complex, std::uint8_t region) {
  return volume(surface_of(complex, 1u << region));
}

void tidy(CellComplex& complex) {
  std::vector<Vec3> corners;
  corners.reserve(3 * complex.facets.size());
  for (const CellFacet& facet : complex.facets) {
    for (const auto corner : facet.corners) corners.push_back(complex.vertices[corner]);
  }
  TriangleMesh indexed = mesh_parsers::index_corners(corners);
  std::map<Triple, std::vector<CellFacet>> stacks;
  std::vector<Triple> order;
  for (std::size_t f = 0; f < complex.facets.size(); ++f) {
    CellFacet facet = complex.facets[f];
    facet.corners = indexed.triangles[f];
    const Triple& t = facet.corners;
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0] || facet.front == facet.back) continue;
    facet = normalised(facet);
    auto& stack = stacks[facet.corners];
    if (stack.empty()) order.push_back(facet.corners);
    stack.push_back(facet);
  }
  complex.vertices = std::move(indexed.vertices);
  complex.facets.clear();
  for (const Triple& corners_of_stack : order) {
    auto& stack = stacks[corners_of_stack];
    collapse_stack(stack);
    for (const CellFacet& facet : stack) {
      if (facet.front != facet.back) complex.facets.push_back(facet);
    }
  }
}

}  // namespace reforge

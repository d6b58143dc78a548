// Several solids that share their borders: facets, each labelled with the region on either side.
//
// Purpose: volumes cut from the same two parts (reused, removed, added, ...) balance and fit
// exactly,
//   because a border between two of them is stored once. Moving matter from one volume to another
//   is relabelling; no boolean is computed twice.
// Units: mm. Coordinates are floats held as doubles: what STL can hold.
// Invariants: the boundary of every region is closed; front != back; corners are distinct; vertices
//   have distinct coordinates. Edges may have more than two facets (where regions meet).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "planner/geometry/mesh.h"

namespace reforge {

struct CellFacet {
  std::array<std::uint32_t, 3> corners;  // counter-clockwise seen from the front
  std::uint8_t front = 0, back = 0;      // regions, 0 to 31; 0 is outside of everything
  std::uint32_t origin = 0;              // facets cut from one facet keep its number
  std::uint32_t mark = 0;  // what made it: 0 an input's surface, else given by the cut
};

struct CellComplex {
  std::vector<Vec3> vertices;
  std::vector<CellFacet> facets;
};

// The closed surface of the union of the regions in `regions` (bit r set: region r). Where the
// union touches itself along an edge, that edge has more than two triangles. `facets`, if given,
// receives the number of the facet behind each triangle.
TriangleMesh surface_of(const CellComplex& complex, unsigned regions,
                        std::vector<std::uint32_t>* facets = nullptr);

// Volume of one region, mm^3.
double volume_of(const CellComplex& complex, std::uint8_t region);

// Restores the invariants after vertices were moved or facets were relabelled: equal vertices
// become one, collapsed facets go, facets that lie on each other become one or vanish.
void tidy(CellComplex& complex);

}  // namespace reforge

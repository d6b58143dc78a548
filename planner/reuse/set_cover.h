// Weighted set cover: the fewest-loss choice of clipping planes that serves every infeasible base.
//
// Source: paper.md Eq. 2 (its index ranges are swapped: i runs over components, j over normals),
// solved as
//   an integer program by GLPK. It minimises the *sum* of the chosen weights and so counts volume
//   that two planes take twice; the search that follows works on the union.
#pragma once

#include <cstddef>
#include <vector>

namespace reforge {

struct CoverSet {
  std::vector<std::size_t> elements;  // numbers below the universe's size
  double weight = 0;                  // >= 0
};

// Numbers of the chosen sets, ascending. Elements that no set has are left uncovered.
std::vector<std::size_t> cheapest_cover(std::size_t universe, const std::vector<CoverSet>& sets);

}  // namespace reforge

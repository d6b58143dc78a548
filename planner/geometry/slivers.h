// Takes needles out of a complex: facets so narrow that rounding to float may have turned them
// over.
//
// Edges shorter than the limit are drawn together; a vertex nearer than the limit to the opposite
// edge of its facet is put on that edge. Regions stay closed; none moves by more than about the
// limit. `given`, by vertex, are those that stay where they are.
// Units: mm. Limits: needles with given corners only stay; eight rounds at most.
#pragma once

#include <vector>

#include "planner/geometry/cell_complex.h"

namespace reforge {

void remove_slivers(CellComplex& complex, const std::vector<bool>& given, double within_mm);

}  // namespace reforge

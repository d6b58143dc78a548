// The printing base: where V_R and V_A touch, and whether a nozzle can start there.
//
// Symbols: B = boundary(V_R) and boundary(V_A); b_i its connected components (through shared
// edges). Plano-convex (paper.md 3.1): b_i consists of planar facets, and every dihedral between
// neighbouring
//   facets, measured inside V_R, is < 180 degrees.
// A *facet* is a connected set of triangles within kFlat of one plane whose normals agree within
//   kSameNormal. A finely tessellated dome is planar triangle by triangle; nobody prints it as
//   such, so a component of more than kMostFacets facets is refused, as are facets that leave more
//   than kSliverArea of the component over.
// Units: mm, part frame; normals point out of V_R.
#pragma once

#include <vector>

#include "planner/geometry/cell_complex.h"
#include "planner/geometry/plane.h"

namespace reforge {

inline constexpr double kFlat = 0.02;          // mm
inline constexpr double kSameNormal = 0.9962;  // cosine of 5 degrees
inline constexpr std::size_t kMostFacets = 8;
inline constexpr double kSliverArea = 0.02;  // of the component

struct BaseComponent {
  std::vector<std::uint32_t> facets;   // numbers in the complex
  std::vector<std::uint32_t> origins;  // their origins, sorted, each once
  std::vector<Vec3> points;            // corners of its triangles, each once
  std::vector<Plane> planes;           // of its planar facets, the largest first
  Vec3 mean_normal = Vec3::UnitZ();    // unit, weighted by area
  double area_mm2 = 0;
  double lowest_z = 0;
  bool plano_convex = false;
  bool from_clipping = false;  // has a facet that a clipping plane made
};

// `is_skin` by origin (volumes.h): what only a skin covers is no base.
// The facets' normals as tool directions: those that do not look down (level within rounding).
std::vector<Vec3> facet_directions(const std::vector<BaseComponent>& bases);

std::vector<BaseComponent> printing_bases(const CellComplex& complex,
                                          const std::vector<bool>& is_skin);

}  // namespace reforge

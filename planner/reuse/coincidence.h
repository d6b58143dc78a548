// Where two solids' surfaces nearly coincide, and how to hold them apart there.
//
// A worn part and its repair share most of their surface, up to rounding or other triangles. To the
// machine those are one surface; to exact booleans they are thousands of crossings. So the target
// is offered in two versions, moved by a hair where it coincides with the initial part and nowhere
// else: `grown`, clear of the initial surface on its outer side, and `shrunk`, on its inner side.
// What is to be removed is initial - grown, what is to be added is shrunk - initial: neither has
// skins, and both are well-conditioned (tolerant_overlay.h).
//
// Coincident: within the tolerance, facing the same way, and not only at the point itself but also
//   a little into the triangle, so that surfaces that merely cross are left alone. The hair is the
//   greatest distance found at the triangles around, and a quarter, and a twentieth of the
//   tolerance. Sides of a vertex's other triangles are slid along, so that rims stay where they
//   are. Where the solids touch back to back, both versions stand back.
// Units: mm. Exactness: contacts are looked for at corners, near them, at edge middles and centres
//   of both surfaces' triangles; corners of the initial part that lie in a triangle of the target
//   which coincides only in part are made vertices of it.
// Limits: a coincident strip that has no such point of either surface is not seen; solids thinner
//   than the tolerance are not told apart from their own back.
#pragma once

#include <cstdint>
#include <vector>

#include "planner/geometry/mesh.h"

namespace reforge {

struct Separation {
  TriangleMesh target;         // the same surface, perhaps with more vertices
  TriangleMesh grown, shrunk;  // the same triangles, vertices moved
  std::vector<bool> moved;     // by triangle: has a moved vertex
  // By triangle: in contact wherever looked at. Two settled triangles do not cross: if the moved
  // target seems to cross the initial part there, it is by the hair alone.
  std::vector<bool> target_settled, initial_settled;
  double coincident_area_mm2 = 0;   // of the target's triangles, by corners moved
  double greatest_distance_mm = 0;  // between coincident surfaces
};

Separation separate(const TriangleMesh& initial, const TriangleMesh& target, double tolerance_mm);

}  // namespace reforge

// Simple solids: closed, outward-oriented triangle meshes, mm. The vocabulary of the project's own
// models and of the tests.
#pragma once

#include "planner/geometry/mesh.h"

namespace reforge {

// Axis-aligned cuboid, 12 triangles.
TriangleMesh make_box(const Vec3& lowest, const Vec3& highest);

// Prism over a regular polygon with `sides` corners on a circle around the segment from `from` to
// `to`.
TriangleMesh make_cylinder(const Vec3& from, const Vec3& to, double radius, int sides);

}  // namespace reforge

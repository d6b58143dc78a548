// What a mesh is as a surface, from its indices alone: edges, welding, orientation, connected
// pieces.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "planner/geometry/mesh.h"

namespace reforge {

// Vertices with bit-equal coordinates become one; vertices no triangle uses go; triangles that lost
// a corner go. The order of what stays is kept.
TriangleMesh welded(const TriangleMesh& mesh);
// Vertices nearer than `within_mm` become one (the earliest); otherwise as welded().
TriangleMesh welded_within(const TriangleMesh& mesh, double within_mm);

// Triangles with the same corners in the same cyclic order are kept once.
TriangleMesh without_duplicates(const TriangleMesh& mesh);

struct EdgeFaults {
  std::size_t open = 0;       // edges of one triangle
  std::size_t crowded = 0;    // edges of three or more
  std::size_t against = 0;    // edges that two triangles run through in the same direction
  std::optional<Vec3> first;  // the middle of the first open, else crowded edge
};
EdgeFaults edge_faults(const TriangleMesh& mesh);

// Whether every directed edge is matched by as many opposite ones: the boundary of a volume, though
// perhaps with edges where more than two triangles meet.
bool is_closed(const TriangleMesh& mesh);

// A vertex whose triangles do not form one fan, if any. The mesh must have two triangles at every
// edge.
std::optional<Vec3> pinched_vertex(const TriangleMesh& mesh);

// Number of the edge-connected piece of each triangle, from 0 in order of first appearance.
std::vector<std::uint32_t> pieces(const TriangleMesh& mesh, std::uint32_t& count);
std::vector<TriangleMesh> split_pieces(const TriangleMesh& mesh);

// Turns triangles so that neighbours agree; returns how many were turned, or nothing when the
// surface has only one side. The mesh must have two triangles at every edge.
std::optional<std::size_t> orient(TriangleMesh& mesh);

TriangleMesh flipped(TriangleMesh mesh);
// Both meshes as one list; nothing is welded.
TriangleMesh joined(const TriangleMesh& a, const TriangleMesh& b);

// Whether a point lies inside a closed mesh, by the solid angle it is seen under; on the surface
// either way. Linear in the triangles.
bool contains(const TriangleMesh& solid, const Vec3& point);

}  // namespace reforge

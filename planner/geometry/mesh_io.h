// Meshes from and to files: STL (binary, ASCII), OFF (also COFF, NOFF, STOFF), OBJ, PLY (ASCII,
// binary).
//
// Purpose: turn bytes into a TriangleMesh, or into one sentence that names the file, the line or
// byte,
//   and what was expected there. Nothing is guessed: an index outside the file, a missing number or
//   a count that the bytes cannot hold is an error.
// Units: numbers are taken as millimetres; mesh_check.h judges whether that is plausible.
// Invariants of a result: every index is valid; vertices may be NaN or infinite (mesh_check.h
// refuses
//   them with a better sentence); polygons are split into fans, so a polygon is taken to be convex.
//   STL corners with equal coordinates are one vertex; nothing else is welded here.
// Limits: colours, normals, texture and materials are read over; files above 1 GiB are refused.
//   Memory is reserved only after the bytes present have been compared with the counts promised.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "planner/geometry/mesh.h"
#include "protocols/result.h"

namespace reforge {

enum class MeshFormat { kStl, kOff, kObj, kPly };

// The format by the file's extension (.stl .off .obj .ply, any case).
Result<TriangleMesh> read_mesh(const std::filesystem::path& file);

// `name` is how the sentence calls the bytes.
Result<TriangleMesh> parse_mesh(std::string_view bytes, MeshFormat format, const std::string& name);

// Binary STL: coordinates are rounded to the nearest float; normals are those of the rounded
// triangles. An empty mesh is a valid file without triangles.
std::string binary_stl(const TriangleMesh& mesh);
Status write_binary_stl(const TriangleMesh& mesh, const std::filesystem::path& file);

// The nearest point, or mesh, with float coordinates, so that what is written to STL is what was
// computed.
Vec3 rounded_to_float(const Vec3& point);
TriangleMesh rounded_to_float(TriangleMesh mesh);

}  // namespace reforge

// Arbitrary bytes as a mesh file: a mesh with valid indices or a sentence, never a crash and never
// more memory than the bytes justify. The first byte chooses the format.
#include <cstdint>
#include <cstdlib>

#include "planner/geometry/mesh_io.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const auto format = static_cast<reforge::MeshFormat>(data[0] % 4);
  const std::string_view bytes(reinterpret_cast<const char*>(data + 1), size - 1);
  const auto mesh = reforge::parse_mesh(bytes, format, "fuzz");
  if (!mesh) return mesh.error().sentence.empty() ? (std::abort(), 0) : 0;
  for (const auto& triangle : mesh->triangles) {
    for (const auto vertex : triangle) {
      if (vertex >= mesh->vertices.size()) std::abort();
    }
  }
  return 0;
}

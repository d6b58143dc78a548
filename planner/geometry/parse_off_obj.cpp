// OFF and OBJ: lists of vertices and polygons as text.
#include "planner/geometry/mesh_parsers.h"

namespace reforge::mesh_parsers {
namespace {

std::string at_line(const Scanner& scanner, const std::string& what) {
  return "line " + std::to_string(scanner.line()) + ": " + what;
}

void add_fan(TriangleMesh& mesh, const std::vector<std::uint32_t>& polygon) {
  for (std::size_t i = 2; i < polygon.size(); ++i) {
    mesh.triangles.push_back({polygon[0], polygon[i - 1], polygon[i]});
  }
}

}  // namespace

Result<TriangleMesh> parse_off(std::string_view text, const std::string& name) {
  Scanner scanner(text, true);
  const auto first = scanner.word_across_lines();
  // ST, C and N announce texture, colour and normal on the vertex line, which are read over.
  if (!first || (*first != "OFF" && *first != "COFF" && *first != "NOFF" && *first != "CNOFF" &&
                 *first != "STOFF" && *first != "STCNOFF")) {
    return malformed(name, "an OFF file begins with 'OFF'.");
  }
  std::int64_t counts[3];  // vertices, faces, edges
  for (auto& count : counts) {
    const auto word = scanner.word_across_lines();
    const auto number = word ? to_integer(*word) : std::nullopt;
    if (!number || *number < 0) {
      return malformed(name,
                       at_line(scanner, "expected the numbers of vertices, faces and edges."));
    }
    count = *number;
  }
  // A vertex takes at least "0 0 0\n", a face "3 0 1 2\n": never reserve for more than can be
  // there.
  if (static_cast<std::uint64_t>(counts[0]) > text.size() / 5 ||
      static_cast<std::uint64_t>(counts[1]) > text.size() / 5) {
    return malformed(name,
                     at_line(scanner, "the counts promise more vertices or faces than a file of " +
                                          std::to_string(text.size()) + " bytes can hold."));
  }
  TriangleMesh mesh;
  mesh.vertices.reserve(static_cast<std::size_t>(counts[0]));
  for (std::int64_t i = 0; i < counts[0]; ++i) {
    if (!scanner.next_line()) {
      return malformed(name, "the file ends after " + std::to_string(i) + " of " +
                                 std::to_string(counts[0]) + " vertices: it is cut off.");
    }
    Vec3 vertex;
    for (int k = 0; k < 3; ++k) {
      const auto word = scanner.word();
      const auto number = word ? to_double(*word) : std::nullopt;
      if (!number) return malformed(name, at_line(scanner, "expected three coordinates."));
      vertex[k] = *number;
    }
    mesh.vertices.push_back(vertex);
  }
  std::vector<std::uint32_t> polygon;
  for (std::int64_t i = 0; i < counts[1]; ++i) {
    if (!scanner.next_line()) {
      return malformed(name, "the file ends after " + std::to_string(i) + " of " +
                                 std::to_string(counts[1]) + " faces: it is cut off.");
    }
    const auto corners_word = scanner.word();
    const auto corners = corners_word ? to_integer(*corners_word) : std::nullopt;
    if (!corners || *corners < 3 || *corners > 1000) {
      return malformed(name,
                       at_line(scanner, "a face begins with its number of corners, 3 to 1000."));
    }
    polygon.clear();
    for (std::int64_t k = 0; k < *corners; ++k) {
      const auto word = scanner.word();
      const auto index = word ? to_integer(*word) : std::nullopt;
      if (!index) {
        return malformed(name, at_line(scanner, "expected " + std::to_string(*corners) +
                                                    " vertex numbers (is the file cut off?)."));
      }
      if (*index < 0 || *index >= counts[0]) {
        return malformed(name,
                         at_line(scanner, "the face refers to vertex " + std::to_string(*index) +
                                              "; there are vertices 0 to " +
                                              std::to_string(counts[0] - 1) + "."));
      }
      polygon.push_back(static_cast<std::uint32_t>(*index));
    }
    add_fan(mesh, polygon);
  }
  if (mesh.triangles.empty()) return malformed(name, "the OFF file has no faces.");
  return mesh;
}

Result<TriangleMesh> parse_obj(std::string_view text, const std::string& name) {
  Scanner scanner(text, true);
  TriangleMesh mesh;
  std::vector<std::uint32_t> polygon;
  while (scanner.next_line()) {
    const auto keyword = *scanner.word();
    if (keyword == "v") {
      Vec3 vertex;
      for (int k = 0; k < 3; ++k) {
        const auto word = scanner.word();
        const auto number = word ? to_double(*word) : std::nullopt;
        if (!number)
          return malformed(name, at_line(scanner, "expected three coordinates after 'v'."));
        vertex[k] = *number;
      }
      mesh.vertices.push_back(vertex);
    } else if (keyword == "f") {
      polygon.clear();
      while (const auto word = scanner.word()) {
        const auto index = to_integer(word->substr(0, word->find('/')));
        const auto count = static_cast<std::int64_t>(mesh.vertices.size());
        // Counted from 1, or backwards from the latest vertex when negative.
        const auto zero_based = !index ? -1 : *index < 0 ? count + *index : *index - 1;
        if (zero_based < 0 || zero_based >= count) {
          return malformed(
              name,
              at_line(scanner, "the face refers to vertex '" + std::string(word->substr(0, 24)) +
                                   "'; there are " + std::to_string(count) + " vertices so far."));
        }
        polygon.push_back(static_cast<std::uint32_t>(zero_based));
      }
      if (polygon.size() < 3)
        return malformed(name, at_line(scanner, "a face has at least 3 corners."));
      add_fan(mesh, polygon);
    } else if (keyword != "vn" && keyword != "vt" && keyword != "vp" && keyword != "g" &&
               keyword != "o" && keyword != "s" && keyword != "usemtl" && keyword != "mtllib" &&
               keyword != "l" && keyword != "p") {
      return malformed(name, at_line(scanner, "'" + std::string(keyword.substr(0, 24)) +
                                                  "' is no OBJ statement a mesh consists of."));
    }
  }
  if (mesh.triangles.empty()) return malformed(name, "the OBJ file has no faces.");
  return mesh;
}

}  // namespace reforge::mesh_parsers

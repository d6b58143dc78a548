// STL, both kinds. Whether a file is binary is decided by its length, not by the word "solid" with
// which many binary files begin: a file of at least 84 + 50 n bytes is binary unless it also reads
// as text. A binary file shorter than its count promises is cut off or lies, and is refused.
#include <algorithm>
#include <cstring>

#include "planner/geometry/mesh_parsers.h"

namespace reforge::mesh_parsers {
namespace {

constexpr std::size_t kHeader = 84, kRecord = 50;
constexpr std::size_t kTolerated = 1024;  // trailing bytes some exporters pad with

float float_at(std::string_view bytes, std::size_t offset) {
  float value = 0;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

bool looks_like_text(std::string_view bytes) {
  if (!bytes.starts_with("solid")) return false;
  const auto head = bytes.substr(0, 4096);
  const bool printable = std::all_of(head.begin(), head.end(), [](char c) {
    return c == '\t' || c == '\n' || c == '\r' || static_cast<unsigned char>(c) >= ' ';
  });
  return printable && (bytes.find("facet") != bytes.npos || bytes.find("endsolid") != bytes.npos);
}

Result<TriangleMesh> parse_binary(std::string_view bytes, const std::string& name) {
  if (bytes.size() < kHeader) {
    return malformed(name, "an STL file has at least " + std::to_string(kHeader) +
                               " bytes; this one has " + std::to_string(bytes.size()) + ".");
  }
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, sizeof count);
  const std::size_t present = (bytes.size() - kHeader) / kRecord;
  if (count > present) {
    return malformed(name, "the STL header promises " + std::to_string(count) + " triangles (" +
                               std::to_string(kHeader + kRecord * std::size_t{count}) +
                               " bytes), but the file ends after " + std::to_string(present) +
                               " (" + std::to_string(bytes.size()) +
                               " bytes): it is cut off or no STL.");
  }
  if (bytes.size() - kHeader - kRecord * count > kTolerated) {
    return malformed(name, "the STL header promises " + std::to_string(count) +
                               " triangles, but there are bytes for " + std::to_string(present) +
                               ".");
  }
  std::vector<Vec3> corners;
  corners.reserve(std::size_t{3} * count);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const std::size_t at = kHeader + kRecord * i + 12 * (corner + 1);
      corners.emplace_back(float_at(bytes, at), float_at(bytes, at + 4), float_at(bytes, at + 8));
    }
  }
  return index_corners(corners);
}

Result<TriangleMesh> parse_ascii(std::string_view text, const std::string& name) {
  Scanner scanner(text, false);
  std::vector<Vec3> corners;
  const auto at_line = [&scanner, &name](const std::string& what) {
    return malformed(name, "line " + std::to_string(scanner.line()) + ": " + what);
  };
  bool ended = false;
  while (scanner.next_line()) {
    const auto keyword = *scanner.word();
    if (keyword == "vertex") {
      Vec3 corner;
      for (int k = 0; k < 3; ++k) {
        const auto word = scanner.word();
        const auto number = word ? to_double(*word) : std::nullopt;
        if (!number) return at_line("expected three coordinates after 'vertex'.");
        corner[k] = static_cast<float>(*number);
      }
      corners.push_back(corner);
    } else if (keyword == "endloop" || keyword == "endfacet") {
      if (corners.size() % 3 != 0) return at_line("a facet has exactly three vertices.");
    } else if (keyword == "endsolid") {
      ended = true;
    } else if (keyword != "solid" && keyword != "facet" && keyword != "outer") {
      return at_line("expected facet, outer, vertex, endloop, endfacet or endsolid, found '" +
                     std::string(keyword.substr(0, 24)) + "'.");
    } else if (keyword == "solid") {
      ended = false;
    }
  }
  if (!ended) return at_line("the file ends without 'endsolid': it is cut off.");
  if (corners.empty()) return malformed(name, "the STL file has no triangles.");
  return index_corners(corners);
}

}  // namespace

Result<TriangleMesh> parse_stl(std::string_view bytes, const std::string& name) {
  return looks_like_text(bytes) ? parse_ascii(bytes, name) : parse_binary(bytes, name);
}

}  // namespace reforge::mesh_parsers

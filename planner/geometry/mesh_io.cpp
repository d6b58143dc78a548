#include "planner/geometry/mesh_io.h"

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>

#include "planner/geometry/mesh_parsers.h"

namespace reforge {
namespace {

constexpr std::uintmax_t kLargestFile = std::uintmax_t{1} << 30;
static_assert(std::endian::native == std::endian::little,
              "STL and our PLY writer are little-endian");

Result<MeshFormat> format_of(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (extension == ".stl") return MeshFormat::kStl;
  if (extension == ".off") return MeshFormat::kOff;
  if (extension == ".obj") return MeshFormat::kObj;
  if (extension == ".ply") return MeshFormat::kPly;
  return Error{Code::kMalformed,
               file.string() +
                   ": a mesh file ends in .stl, .off, .obj or .ply; this one ends in '" +
                   extension + "'."};
}

void append_float(std::string& bytes, double value) {
  const float rounded = static_cast<float>(value);
  char raw[sizeof rounded];
  std::memcpy(raw, &rounded, sizeof rounded);
  bytes.append(raw, sizeof rounded);
}

}  // namespace

Result<TriangleMesh> read_mesh(const std::filesystem::path& file) {
  const auto format = format_of(file);
  if (!format) return format.error();
  std::error_code failed;
  const auto size = std::filesystem::file_size(file, failed);
  if (failed) {
    return Error{Code::kUnreadable, file.string() + ": cannot be read: " + failed.message() + "."};
  }
  if (size > kLargestFile) {
    return Error{Code::kOutOfRange, file.string() +
                                        ": larger than 1 GiB, which is more than any part "
                                        "for this machine needs."};
  }
  std::ifstream stream(file, std::ios::binary);
  std::string bytes(size, '\0');
  if (!stream.read(bytes.data(), static_cast<std::streamsize>(size))) {
    return Error{Code::kUnreadable, file.string() + ": cannot be read to its end."};
  }
  return parse_mesh(bytes, *format, file.string());
}

Result<TriangleMesh> parse_mesh(std::string_view bytes, MeshFormat format,
                                const std::string& name) {
  if (bytes.empty()) return mesh_parsers::malformed(name, "the file is empty (0 bytes).");
  switch (format) {
    case MeshFormat::kStl:
      return mesh_parsers::parse_stl(bytes, name);
    case MeshFormat::kOff:
      return mesh_parsers::parse_off(bytes, name);
    case MeshFormat::kObj:
      return mesh_parsers::parse_obj(bytes, name);
    case MeshFormat::kPly:
      return mesh_parsers::parse_ply(bytes, name);
  }
  assert(false);
  return mesh_parsers::malformed(name, "unknown format.");
}

std::string binary_stl(const TriangleMesh& mesh) {
  std::string bytes(80, '\0');
  bytes.reserve(84 + 50 * mesh.triangles.size());
  const auto count = static_cast<std::uint32_t>(mesh.triangles.size());
  char raw[sizeof count];
  std::memcpy(raw, &count, sizeof count);
  bytes.append(raw, sizeof count);
  for (const auto& triangle : mesh.triangles) {
    Vec3 corner[3];
    for (int i = 0; i < 3; ++i) {
      corner[i] = rounded_to_float(mesh.vertices[triangle[i]]);
    }
    const Vec3 cross = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
    const double length = cross.norm();
    const Vec3 normal = length > 0 ? Vec3(cross / length) : Vec3(Vec3::Zero());
    for (int k = 0; k < 3; ++k) append_float(bytes, normal[k]);
    for (const Vec3& point : corner) {
      for (int k = 0; k < 3; ++k) append_float(bytes, point[k]);
    }
    bytes.append(2, '\0');
  }
  return bytes;
}

Status write_binary_stl(const TriangleMesh& mesh, const std::filesystem::path& file) {
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  const std::string bytes = binary_stl(mesh);
  stream.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  stream.close();
  if (!stream) return Error{Code::kUnreadable, file.string() + ": cannot be written."};
  return Unit{};
}

Vec3 rounded_to_float(const Vec3& point) {
  // volatile: g++ 12 at -O2 drops the way to float and back when it packs two of them into a
  // vector (-ftree-slp-vectorize), and leaves x and y as they were.
  const auto rounded = [](double x) {
    const volatile float narrow = static_cast<float>(x);
    return static_cast<double>(narrow) + 0.0;  // + 0 turns -0 into 0
  };
  return {rounded(point.x()), rounded(point.y()), rounded(point.z())};
}

TriangleMesh rounded_to_float(TriangleMesh mesh) {
  for (Vec3& vertex : mesh.vertices) vertex = rounded_to_float(vertex);
  return mesh;
}

}  // namespace reforge

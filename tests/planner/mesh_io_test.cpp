#include "planner/geometry/mesh_io.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "planner/geometry/shapes.h"

namespace reforge {
namespace {

// A tetrahedron with volume 1/6, as each format writes it.
const std::string kOff =
    "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
const std::string kObj =
    "# a comment\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1/1 2/2 4/3\nf 1//1 4//2 3//3\nf "
    "-3 -2 -1\n";
const std::string kPly =
    "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty "
    "float y\n"
    "property float z\nproperty uchar red\nelement face 4\nproperty list uchar int vertex_indices\n"
    "end_header\n0 0 0 9\n1 0 0 9\n0 1 0 9\n0 0 1 9\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

Result<TriangleMesh> parse(const std::string& bytes, MeshFormat format) {
  return parse_mesh(bytes, format, "part");
}

void expect_refused(const std::string& bytes, MeshFormat format, const std::string& because) {
  const auto mesh = parse(bytes, format);
  ASSERT_FALSE(mesh.ok());
  EXPECT_EQ(mesh.error().code, Code::kMalformed);
  EXPECT_TRUE(mesh.error().sentence.starts_with("part: ")) << mesh.error().sentence;
  EXPECT_NE(mesh.error().sentence.find(because), std::string::npos) << mesh.error().sentence;
}

TEST(MeshIo, EveryTextFormatReadsTheSameTetrahedron) {
  for (const auto& [text, format] :
       {std::pair{kOff, MeshFormat::kOff}, {kObj, MeshFormat::kObj}, {kPly, MeshFormat::kPly}}) {
    const auto mesh = parse(text, format);
    ASSERT_TRUE(mesh.ok()) << mesh.error().sentence;
    EXPECT_EQ(mesh->vertices.size(), 4u);
    EXPECT_EQ(mesh->triangles.size(), 4u);
    EXPECT_DOUBLE_EQ(volume(*mesh), 1.0 / 6);
  }
}

TEST(MeshIo, BinaryStlReturnsWhatWasWritten) {
  const auto box = make_box(Vec3(-1, -2, 0), Vec3(4, 5, 6));
  const auto read = parse(binary_stl(box), MeshFormat::kStl);
  ASSERT_TRUE(read.ok()) << read.error().sentence;
  EXPECT_EQ(read->vertices.size(), 8u);
  EXPECT_EQ(read->triangles.size(), 12u);
  EXPECT_DOUBLE_EQ(volume(*read), volume(box));
}

TEST(MeshIo, RoundingReachesEveryCoordinate) {
  TriangleMesh mesh;
  mesh.vertices = {Vec3(0.1, 0.2, 0.3), Vec3(-1.1, -0.0, 16.9999)};
  const TriangleMesh rounded = rounded_to_float(mesh);
  for (std::size_t v = 0; v < 2; ++v) {
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(rounded.vertices[v][k],
                static_cast<double>(static_cast<float>(mesh.vertices[v][k])));
    }
  }
}

TEST(MeshIo, AnEmptyMeshWritesAValidFileWithoutTriangles) {
  EXPECT_EQ(binary_stl({}), std::string(84, '\0'));
}

TEST(MeshIo, ABinaryStlMayBeginWithSolid) {
  auto bytes = binary_stl(make_box(Vec3(0, 0, 0), Vec3(1, 1, 1)));
  bytes.replace(0, 5, "solid");
  EXPECT_TRUE(parse(bytes, MeshFormat::kStl).ok());
}

TEST(MeshIo, AsciiStlJoinsEqualCorners) {
  std::string text = "solid t\r\n";
  for (const char* corners :
       {"0 0 0|0 1 0|1 0 0", "0 0 0|1 0 0|0 0 1", "-0 0 0|0 0 1|0 1 0", "1 0 0|0 1 0|0 0 1"}) {
    text += "facet normal 0 0 0\r\n outer loop\r\n";
    std::string list = corners;
    for (std::size_t bar; (bar = list.find('|')) != list.npos; list.erase(0, bar + 1)) {
      text += "vertex " + list.substr(0, bar) + "\r\n";
    }
    text += "vertex " + list + "\r\nendloop\r\nendfacet\r\n";
  }
  const auto mesh = parse(text + "endsolid t\r\n", MeshFormat::kStl);
  ASSERT_TRUE(mesh.ok()) << mesh.error().sentence;
  EXPECT_EQ(mesh->vertices.size(), 4u);
  EXPECT_DOUBLE_EQ(volume(*mesh), 1.0 / 6);
  expect_refused(text, MeshFormat::kStl, "cut off");
}

TEST(MeshIo, AStlHeaderThatPromisesTooMuchIsRefusedBeforeMemoryIsTaken) {
  auto bytes = binary_stl(make_box(Vec3(0, 0, 0), Vec3(1, 1, 1)));
  bytes.replace(80, 4, "\xff\xff\xff\xff");
  expect_refused(bytes, MeshFormat::kStl, "4294967295 triangles");
}

TEST(MeshIo, OffReadsColourCommentsQuadsAndCountsOnTheFirstLine) {
  const auto mesh = parse(
      "COFF 5 5 0 # a pyramid\r\n0 0 0 255 0 0\r\n1 0 0 255 0 0\r\n1 1 0 1 1 1\r\n\r\n0 1 0 1 1 "
      "1\r\n"
      "0.5 0.5 1 0 0 0\r\n4 3 2 1 0\r\n3 0 1 4\r\n3 1 2 4\r\n3 2 3 4\r\n3 3 0 4\r\n",
      MeshFormat::kOff);
  ASSERT_TRUE(mesh.ok()) << mesh.error().sentence;
  EXPECT_EQ(mesh->triangles.size(), 6u);
  EXPECT_DOUBLE_EQ(volume(*mesh), 1.0 / 3);
}

TEST(MeshIo, OffNamesTheLineOfAnIndexThatDoesNotExist) {
  std::string text = kOff;
  text.replace(text.rfind('3'), 1, "99");
  expect_refused(text, MeshFormat::kOff, "line 10: the face refers to vertex 99");
}

TEST(MeshIo, OffCountsBeyondTheFileAreRefused) {
  expect_refused("OFF\n4000000000 4 0\n0 0 0\n", MeshFormat::kOff, "can hold");
}

TEST(MeshIo, OffCutShortIsRefused) {
  expect_refused(kOff.substr(0, kOff.size() - 12), MeshFormat::kOff, "cut");
}

TEST(MeshIo, ObjIndexBeyondTheVerticesIsRefused) {
  expect_refused("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", MeshFormat::kObj, "line 4");
  expect_refused("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n", MeshFormat::kObj, "'-4'");
}

TEST(MeshIo, BinaryPlyReadsBothByteOrders) {
  for (const bool big : {false, true}) {
    std::string bytes =
        std::string("ply\nformat ") + (big ? "binary_big_endian" : "binary_little_endian") +
        " 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar uint vertex_index\nend_header\n";
    const auto append = [&](std::uint32_t word) {
      for (int i = 0; i < 4; ++i) {
        bytes.push_back(static_cast<char>(word >> (big ? 24 - 8 * i : 8 * i)));
      }
    };
    const std::uint32_t one = 0x3f800000, zero = 0;  // as floats
    for (const auto value : {zero, zero, zero, one, zero, zero, zero, one, zero}) append(value);
    bytes.push_back(3);
    for (const std::uint32_t index : {0u, 1u, 2u}) append(index);
    const auto mesh = parse(bytes, MeshFormat::kPly);
    ASSERT_TRUE(mesh.ok()) << mesh.error().sentence;
    EXPECT_DOUBLE_EQ(area(*mesh), 0.5);
    bytes.pop_back();
    expect_refused(bytes, MeshFormat::kPly, "cut off");
  }
}

TEST(MeshIo, NotANumberIsReadAndLeftToTheCheck) {
  std::string text = kOff;
  text.replace(text.find("1 0 0"), 1, "nan");
  const auto mesh = parse(text, MeshFormat::kOff);
  ASSERT_TRUE(mesh.ok());
  EXPECT_TRUE(std::isnan(mesh->vertices[1].x()));
}

TEST(MeshIo, AFileOfUnknownKindOrMissingIsRefusedByName) {
  EXPECT_NE(read_mesh("part.step").error().sentence.find("part.step"), std::string::npos);
  EXPECT_EQ(read_mesh("no-such-part.stl").error().code, Code::kUnreadable);
}

}  // namespace
}  // namespace reforge

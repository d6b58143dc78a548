#include "planner/geometry/mesh_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "planner/geometry/mesh_topology.h"
#include "planner/geometry/shapes.h"

namespace reforge {
namespace {

RigDescription rig() {
  auto read = read_rig(std::filesystem::path(REFORGE_SOURCE_DIR) / "config/rigs/mx220.json");
  EXPECT_TRUE(read.ok());
  return *read;
}

TriangleMesh block() {
  return make_box(Vec3(-10, -20, 5), Vec3(20, 20, 35));
}

void expect_refused(const TriangleMesh& mesh, const std::string& because) {
  const auto part = check_part(mesh, "part.stl", rig());
  ASSERT_FALSE(part.ok());
  EXPECT_TRUE(part.error().sentence.starts_with("part.stl: ")) << part.error().sentence;
  EXPECT_NE(part.error().sentence.find(because), std::string::npos) << part.error().sentence;
}

TEST(MeshCheck, APartIsPutOnTheBaseInTheMiddleAndCanBePutBack) {
  const auto part = check_part(block(), "part.stl", rig());
  ASSERT_TRUE(part.ok()) << part.error().sentence;
  EXPECT_EQ(bounds(part->mesh).min(), Vec3(-15, -20, 0));
  EXPECT_EQ(part->placement.translation, Vec3(-5, 0, -5));
  EXPECT_TRUE(part->notes.empty());
  EXPECT_EQ(bounds(part->in_file).min(), Vec3(-10, -20, 5));
}

TEST(MeshCheck, AWidePartIsTurnedToFit) {
  const auto part = check_part(make_box(Vec3(0, 0, 0), Vec3(50, 180, 20)), "part.stl", rig());
  ASSERT_TRUE(part.ok());
  EXPECT_TRUE(part->placement.turned);
  EXPECT_DOUBLE_EQ(bounds(part->mesh).sizes().x(), 180);
  EXPECT_GT(volume(part->mesh), 0);
  EXPECT_EQ(part->notes.size(), 1u);
}

TEST(MeshCheck, AnInsideOutSurfaceIsTurned) {
  const auto part = check_part(flipped(block()), "part.stl", rig());
  ASSERT_TRUE(part.ok());
  EXPECT_DOUBLE_EQ(volume(part->mesh), volume(block()));
  EXPECT_EQ(part->notes.size(), 1u);
}

TEST(MeshCheck, CracksAreJoinedAndSaid) {
  TriangleMesh cracked;
  for (const auto& triangle : block().triangles) {
    for (const auto vertex : triangle) {
      const double jitter = 2e-5 * static_cast<double>(cracked.vertices.size() % 3);
      cracked.vertices.push_back(block().vertices[vertex] + Vec3::Constant(jitter));
    }
    const auto n = static_cast<std::uint32_t>(cracked.vertices.size());
    cracked.triangles.push_back({n - 3, n - 2, n - 1});
  }
  const auto part = check_part(cracked, "part.stl", rig());
  ASSERT_TRUE(part.ok()) << part.error().sentence;
  EXPECT_TRUE(is_closed(part->mesh));
  EXPECT_EQ(part->notes.size(), 1u);
}

TEST(MeshCheck, FaultsAreNamed) {
  TriangleMesh open = block();
  open.triangles.pop_back();
  expect_refused(open, "not closed");
  TriangleMesh infinite = block();
  infinite.vertices[3].x() = std::nan("");
  expect_refused(infinite, "not finite");
  expect_refused(make_box(Vec3(0, 0, 0), Vec3(0.04, 0.03, 0.02)), "metres");
  expect_refused(make_box(Vec3(0, 0, 0), Vec3(230, 60, 40)), "does not fit");
  expect_refused(joined(block(), translated(block(), Vec3(50, 0, 0))), "2 separate solids");
  expect_refused(joined(block(), translated(block(), Vec3(10, 3, 4))), "pass through each other");
  expect_refused(joined(block(), flipped(make_box(Vec3(0, 0, 10), Vec3(5, 5, 20)))), "cavity");
  expect_refused(TriangleMesh{}, "no triangles");
}

#ifdef REFORGE_SHARED_MODELS
TEST(MeshCheck, EveryBadFileEndsAsExpected) {
  const std::filesystem::path folder = std::filesystem::path(REFORGE_SHARED_MODELS) / "bad";
  std::ifstream stream(folder / "EXPECTED.json");
  const auto expected = nlohmann::json::parse(stream);
  const RigDescription description = rig();
  for (const auto& [name, entry] : expected.items()) {
    const std::string expect = entry["expect"];
    const auto part = load_part(folder / name, description);
    if (expect == "reject") {
      EXPECT_FALSE(part.ok()) << name;
    }
    if (expect.starts_with("accept") && expect.find("reject") == std::string::npos) {
      EXPECT_TRUE(part.ok()) << name;
    }
    if (part.ok()) {
      EXPECT_TRUE(is_closed(part->mesh)) << name;
      // What was mended is said.
      if (expect.find("repair") != std::string::npos) {
        EXPECT_FALSE(part->notes.empty()) << name;
      }
    } else {
      EXPECT_NE(part.error().sentence.find(name), std::string::npos) << part.error().sentence;
    }
  }
}
#endif

}  // namespace
}  // namespace reforge

// Plane cuts where rounding has left surfaces that touch, overlap or cross by a little.
#include "planner/geometry/plane_cut.h"

#include <gtest/gtest.h>

#include <random>

#include "planner/geometry/mesh_io.h"
#include "planner/geometry/mesh_topology.h"
#include "planner/geometry/plane_caps.h"
#include "planner/geometry/shapes.h"

namespace reforge {
namespace {

TriangleMesh box(const Vec3& low, const Vec3& high) {
  return rounded_to_float(make_box(low, high));
}

void expect_cut(const TriangleMesh& solid, const Plane& plane, double near, double far,
                double tolerance) {
  const auto sides = split_by(solid, plane);
  ASSERT_TRUE(sides.ok()) << sides.error().sentence;
  EXPECT_TRUE(is_closed(sides->first));
  EXPECT_TRUE(is_closed(sides->second));
  EXPECT_NEAR(volume(sides->first), near, tolerance);
  EXPECT_NEAR(volume(sides->second), far, tolerance);
}

TEST(PlaneCut, PiecesThatOverlapByARoundingErrorAreCut) {
  // The outlines of the two boxes cross each other at every height.
  const auto overlapping =
      joined(box(Vec3(0, 0, 0), Vec3(1, 1, 2)), box(Vec3(0.999998, 0.3, 0), Vec3(2, 0.7, 2)));
  expect_cut(overlapping, Plane{Vec3::UnitZ(), 0.5}, 0.7, 2.1, 1e-4);
  expect_cut(overlapping, Plane{-Vec3::UnitZ(), -0.5}, 2.1, 0.7, 1e-4);
}

TEST(PlaneCut, PiecesThatReallyOverlapAreCutEachForItself) {
  const auto overlapping =
      joined(box(Vec3(0, 0, 0), Vec3(1, 1, 2)), box(Vec3(0.75, 0.3, 0), Vec3(2, 0.7, 2)));
  expect_cut(overlapping, Plane{Vec3::UnitZ(), 0.5}, 0.75, 2.25, 1e-6);
}

TEST(PlaneCut, AFaceThatWaversAboutThePlaneIsCut) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> waver(-4e-5, 4e-5);
  constexpr int kSide = 12;
  // A block of 12 x 12 columns whose top corners lie a little above or below z = 1.
  TriangleMesh block;
  const auto at = [](int i, int j, int top) {
    return static_cast<std::uint32_t>(2 * (i * (kSide + 1) + j) + top);
  };
  for (int i = 0; i <= kSide; ++i) {
    for (int j = 0; j <= kSide; ++j) {
      block.vertices.push_back(rounded_to_float(Vec3(i, j, 0)));
      block.vertices.push_back(rounded_to_float(Vec3(i, j, 1 + waver(random))));
    }
  }
  for (int i = 0; i < kSide; ++i) {
    for (int j = 0; j < kSide; ++j) {
      block.triangles.push_back({at(i, j, 1), at(i + 1, j, 1), at(i + 1, j + 1, 1)});
      block.triangles.push_back({at(i, j, 1), at(i + 1, j + 1, 1), at(i, j + 1, 1)});
      block.triangles.push_back({at(i, j, 0), at(i + 1, j + 1, 0), at(i + 1, j, 0)});
      block.triangles.push_back({at(i, j, 0), at(i, j + 1, 0), at(i + 1, j + 1, 0)});
    }
  }
  const auto wall = [&](int i, int j, int k, int l) {
    block.triangles.push_back({at(i, j, 0), at(k, l, 0), at(k, l, 1)});
    block.triangles.push_back({at(i, j, 0), at(k, l, 1), at(i, j, 1)});
  };
  for (int i = 0; i < kSide; ++i) {
    wall(i, 0, i + 1, 0);
    wall(i + 1, kSide, i, kSide);
    wall(0, i + 1, 0, i);
    wall(kSide, i, kSide, i + 1);
  }
  ASSERT_TRUE(is_closed(block));
  for (const double height : {1 - 2e-5, 1.0, 1 + 1e-5}) {
    const auto sides = split_by(block, Plane{Vec3::UnitZ(), height});
    ASSERT_TRUE(sides.ok()) << sides.error().sentence;
    EXPECT_TRUE(is_closed(sides->first));
    EXPECT_TRUE(is_closed(sides->second));
    EXPECT_NEAR(volume(sides->first) + volume(sides->second), volume(block), 1e-6);
  }
}

TEST(PlaneCut, APartFarFromTheOriginIsCutAsWell) {
  // Rounding to float moves points by more than 1e-5 mm there.
  const auto block = make_cylinder(Vec3(190, -170, 0), Vec3(191, -171, 220), 15, 48);
  const auto solid = rounded_to_float(block);
  for (const Vec3& normal : {Vec3(0.48, -0.6, 0.64), Vec3(-0.6, 0.64, 0.48), Vec3(0.8, 0, 0.6)}) {
    const auto sides = split_by(solid, Plane::through(Vec3(190.5, -170.5, 110), normal));
    ASSERT_TRUE(sides.ok()) << sides.error().sentence;
    EXPECT_TRUE(is_closed(sides->first));
    EXPECT_TRUE(is_closed(sides->second));
    EXPECT_NEAR(volume(sides->first) + volume(sides->second), volume(solid), 1e-2);
    EXPECT_GT(volume(sides->first), 1e4);
    EXPECT_GT(volume(sides->second), 1e4);
  }
}

TEST(PlaneCaps, ASquareWithAHoleIsFilledOnce) {
  const std::vector<Vec3> corners{{0, 0, 5}, {4, 0, 5}, {4, 4, 5}, {0, 4, 5},
                                  {1, 1, 5}, {1, 3, 5}, {3, 3, 5}, {3, 1, 5}};
  const Outline outline{{{0, 1}, 1}, {{1, 2}, 1}, {{2, 3}, 1}, {{0, 3}, -1},
                        {{4, 5}, 1}, {{5, 6}, 1}, {{6, 7}, 1}, {{4, 7}, -1}};
  const Caps caps = fill_outline(corners, outline, Plane{Vec3::UnitZ(), 5}, 1e-5);
  EXPECT_TRUE(caps.changes.empty());
  EXPECT_EQ(caps.folded_mm2, 0);
  TriangleMesh filled{corners, caps.triangles};
  EXPECT_DOUBLE_EQ(area(filled), 12);
}

TEST(PlaneCaps, CrossingEdgesAskForACornerWhereTheyCross) {
  const std::vector<Vec3> corners{{0, 0, 0}, {2, 2, 0}, {2, 0, 0}, {0, 2, 0}};
  const Outline bow_tie{{{0, 1}, 1}, {{1, 2}, 1}, {{2, 3}, 1}, {{0, 3}, -1}};
  const Caps caps = fill_outline(corners, bow_tie, Plane{Vec3::UnitZ(), 0}, 1e-5);
  ASSERT_EQ(caps.changes.created.size(), 1u);
  EXPECT_EQ(caps.changes.created.front(), Vec3(1, 1, 0));
  EXPECT_EQ(caps.changes.divided.size(), 2u);
}

}  // namespace
}  // namespace reforge

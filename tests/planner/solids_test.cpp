// Cutting solids along each other and by planes.
#include <gtest/gtest.h>

#include "planner/geometry/cgal_mesh.h"
#include "planner/geometry/mesh_topology.h"
#include "planner/geometry/plane_cut.h"
#include "planner/geometry/shapes.h"
#include "planner/geometry/voxel_set.h"

namespace reforge {
namespace {

TriangleMesh box(double x0, double y0, double z0, double x1, double y1, double z1) {
  return make_box(Vec3(x0, y0, z0), Vec3(x1, y1, z1));
}

void expect_solid(const TriangleMesh& mesh, double expected_volume) {
  EXPECT_TRUE(is_closed(mesh));
  EXPECT_NEAR(volume(mesh), expected_volume, 1e-4);
}

TEST(Solids, OverlappingBoxesShareTheirVolumesExactly) {
  const auto a = box(0, 0, 0, 10, 10, 10), b = box(5, 5, -5, 15, 15, 5);
  const auto both = overlay(a, b);
  ASSERT_TRUE(both.ok()) << both.error().sentence;
  expect_solid(surface_of(*both, 1u << 3), 125);
  expect_solid(surface_of(*both, 1u << 1), 875);
  expect_solid(surface_of(*both, 1u << 2), 875);
  expect_solid(surface_of(*both, 1u << 1 | 1u << 2 | 1u << 3), 1875);
}

TEST(Solids, ACoincidingWallIsOneWall) {
  // b stands in a corner of a: three of its faces lie in faces of a.
  const auto a = box(0, 0, 0, 10, 10, 10), b = box(0, 0, 0, 4, 5, 6);
  const auto both = overlay(a, b);
  ASSERT_TRUE(both.ok());
  expect_solid(surface_of(*both, 1u << 3), 120);
  expect_solid(surface_of(*both, 1u << 1), 880);
  EXPECT_TRUE(surface_of(*both, 1u << 2).empty());
}

TEST(Solids, SolidsThatOnlyTouchDoNotIntersect) {
  const auto a = box(0, 0, 0, 10, 10, 10), b = box(10, 0, 0, 20, 10, 10);
  EXPECT_TRUE(boolean_intersection(a, b)->empty());
  expect_solid(*boolean_union(a, b), 2000);
  expect_solid(*boolean_difference(a, b), 1000);
}

TEST(Solids, AResultCanBeUsedAgain) {
  auto block = boolean_difference(box(0, 0, 0, 30, 20, 10),
                                  make_cylinder(Vec3(15, 10, -1), Vec3(15, 10, 11), 5, 32));
  ASSERT_TRUE(block.ok());
  const double left = volume(*block);
  const auto gouged = boolean_difference(*block, box(10, -1, 8, 20, 21, 11));
  ASSERT_TRUE(gouged.ok()) << gouged.error().sentence;
  const auto gouge = boolean_difference(*block, *gouged);
  ASSERT_TRUE(gouge.ok()) << gouge.error().sentence;
  EXPECT_NEAR(volume(*gouged) + volume(*gouge), left, 1e-3);
  EXPECT_LT(volume(*gouged), left - 100);
}

TEST(Solids, IdenticalSolidsLeaveNothing) {
  const auto a = make_cylinder(Vec3(0, 0, 0), Vec3(1, 2, 9), 4, 23);
  const auto both = overlay(a, a);
  ASSERT_TRUE(both.ok());
  EXPECT_TRUE(surface_of(*both, 1u << 1).empty());
  EXPECT_TRUE(surface_of(*both, 1u << 2).empty());
  expect_solid(surface_of(*both, 1u << 3), volume(a));
}

TEST(PlaneCut, BothSidesOfATiltedCutAddUp) {
  const auto solid = make_cylinder(Vec3(1, 2, 0), Vec3(4, 1, 9), 3, 17);
  const auto sides = split_by(solid, Plane::through(Vec3(2.5, 1.5, 4), Vec3(0.48, -0.6, 0.64)));
  ASSERT_TRUE(sides.ok()) << sides.error().sentence;
  EXPECT_TRUE(is_closed(sides->first));
  EXPECT_TRUE(is_closed(sides->second));
  EXPECT_NEAR(volume(sides->first) + volume(sides->second), volume(solid), 1e-3);
  EXPECT_GT(volume(sides->first), 10);
  EXPECT_GT(volume(sides->second), 10);
}

TEST(PlaneCut, APlaneThroughCornersAndFacesCutsCleanly) {
  const auto cube = box(0, 0, 0, 2, 2, 2);
  const auto diagonal = split_by(cube, Plane::through(Vec3(0, 0, 0), Vec3(1, -1, 0).normalized()));
  ASSERT_TRUE(diagonal.ok());
  expect_solid(diagonal->first, 4);
  expect_solid(diagonal->second, 4);
  const auto on_top = split_by(cube, Plane{Vec3::UnitZ(), 2});
  expect_solid(on_top->first, 8);
  EXPECT_TRUE(on_top->second.empty());
  const auto below = split_by(cube, Plane{Vec3::UnitZ(), 0});
  EXPECT_TRUE(below->first.empty());
  expect_solid(below->second, 8);
}

TEST(PlaneCut, ARingIsCappedTwice) {
  const auto ring = boolean_difference(make_cylinder(Vec3(0, 0, 0), Vec3(0, 0, 5), 10, 40),
                                       make_cylinder(Vec3(0, 0, -1), Vec3(0, 0, 6), 6, 40));
  ASSERT_TRUE(ring.ok());
  const auto across = split_by(*ring, Plane{Vec3::UnitX(), 0.3});
  ASSERT_TRUE(across.ok());
  EXPECT_NEAR(volume(across->first) + volume(across->second), volume(*ring), 1e-3);
  const auto level = split_by(*ring, Plane{Vec3::UnitZ(), 2.5});
  expect_solid(level->first, volume(*ring) / 2);
  expect_solid(level->second, volume(*ring) / 2);
}

TEST(PlaneCut, OnlyTheWantedPieceIsCutOff) {
  auto fork = boolean_union(box(0, 0, 0, 30, 10, 10), box(0, 0, 10, 8, 10, 30));
  fork = boolean_union(*fork, box(22, 0, 10, 30, 10, 30));
  ASSERT_TRUE(fork.ok());
  CellComplex complex;
  complex.vertices = fork->vertices;
  for (const auto& t : fork->triangles) complex.facets.push_back({t, 0, 1, 0, 0});
  const auto used = cut_off(complex, Plane{Vec3::UnitZ(), 20}, 1, 2, 7, [](const FarPiece& piece) {
    return bounds(piece.surface).min().x() > 15;
  });
  ASSERT_TRUE(used.ok());
  EXPECT_NEAR(volume_of(complex, 2), 800, 1e-6);
  EXPECT_NEAR(volume_of(complex, 1), volume(*fork) - 800, 1e-6);
  for (const auto& facet : complex.facets) {
    EXPECT_EQ(facet.mark == 7, facet.front + facet.back == 3);
  }
}

TEST(Voxels, CountTimesVoxelIsTheVolume) {
  const auto solid = make_cylinder(Vec3(0, 0, 0), Vec3(3, 1, 20), 8, 31);
  const auto set = sample(solid, VoxelGrid::over(bounds(solid), 0.5));
  EXPECT_NEAR(static_cast<double>(set.size()) * set.voxel_volume(), volume(solid),
              0.005 * volume(solid));
  for (std::uint32_t i = 0; i < set.size(); i += 97) {
    EXPECT_TRUE(contains(solid, set.points[i]));
    EXPECT_EQ(set.number_at(set.points[i]), static_cast<std::int32_t>(i));
  }
}

TEST(Voxels, ColumnsThroughEdgesAndCornersDoNotLeak) {
  const auto cube = box(-2, -2, 0, 2, 2, 4);  // centres fall on the diagonals of its faces
  VoxelGrid grid;
  grid.origin = Vec3(-3, -3, 0.5);
  grid.size = {7, 7, 6};
  const auto set = sample(cube, grid);
  for (const Vec3& point : set.points) EXPECT_LT(point.z(), 4);
  EXPECT_EQ(set.size() % 4, 0u);
}

TEST(Voxels, ComponentsAreSeparatedByAGap) {
  const auto two = joined(box(0, 0, 0, 4, 4, 4), box(6, 0, 0, 10, 4, 4));
  const auto set = sample(two, VoxelGrid::over(bounds(two), 1));
  BitSet all(set.size());
  for (std::uint32_t i = 0; i < set.size(); ++i) all.set(i);
  const auto found = components(set, all, Connectivity::kCorners);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].count(), 64u);
  EXPECT_EQ(found[1].count(), 64u);
}

}  // namespace
}  // namespace reforge

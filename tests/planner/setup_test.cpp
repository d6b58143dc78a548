// Where the target is put: poses known by hand.
#include "planner/reuse/setup.h"

#include <gtest/gtest.h>

#include "planner/geometry/cgal_mesh.h"
#include "planner/geometry/convex_hull.h"
#include "planner/geometry/mesh_io.h"
#include "planner/geometry/shapes.h"
#include "planner/reuse/setup_paper.h"
#include "planner/reuse/setup_search.h"
#include "protocols/rig.h"

namespace reforge {
namespace {

RigDescription rig() {
  return *read_rig(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220.json");
}
TriangleMesh box(double x0, double y0, double z0, double x1, double y1, double z1) {
  return rounded_to_float(make_box(Vec3(x0, y0, z0), Vec3(x1, y1, z1)));
}
LoadedPart part(const TriangleMesh& mesh) {
  const auto checked = check_part(mesh, "part.stl", rig());
  EXPECT_TRUE(checked.ok()) << checked.error().sentence;
  return *checked;
}
// A block with a lower one beside it: of no symmetry but the one at y = 6.
TriangleMesh step() {
  return *boolean_union(box(0, 0, 0, 30, 12, 8), box(0, 0, 8, 10, 12, 20));
}
TriangleMesh turned_about_z(TriangleMesh mesh, double angle) {
  for (Vec3& vertex : mesh.vertices) vertex = yawed(angle) * vertex;
  return rounded_to_float(std::move(mesh));
}

TEST(Setup, AllRegisteredPosesKeepTheirCoordinates) {
  const LoadedPart initial = part(step()), target = part(box(1, 1, 0, 9, 11, 20));
  std::vector<std::string> why;
  const auto stored = place_target(initial, target, rig(), Setup::kStored, why);
  ASSERT_EQ(stored.size(), 1u);
  EXPECT_EQ(stored[0].placement.translation, initial.placement.translation);
  EXPECT_NEAR(common_share(initial.mesh, stored[0].mesh).standing, 1, 1e-3);
}

TEST(Setup, SearchFindsTheSpinAndTheSideToRestOn) {
  const LoadedPart initial = part(step());
  for (const double angle : {0.7, M_PI / 2, 2.5}) {
    SCOPED_TRACE(angle);
    // Smaller by a little all round, spun, and lying on its back.
    TriangleMesh lying =
        *boolean_union(box(0.5, 0.5, 0, 29.5, 11.5, 7.5), box(0.5, 0.5, 7.5, 9.5, 11.5, 19.5));
    for (Vec3& v : lying.vertices) v = Vec3(v.x(), -v.z(), v.y());
    const LoadedPart target = part(turned_about_z(rounded_to_float(lying), angle));
    std::vector<std::string> why;
    const auto found = place_target(initial, target, rig(), Setup::kSearch, why);
    ASSERT_FALSE(found.empty());
    EXPECT_EQ(found[0].setup, "search");
    EXPECT_GT(found[0].share, 0.99);
    EXPECT_NEAR(bounds(found[0].mesh).min().z(), 0, 1e-9);
    EXPECT_NEAR(volume(found[0].mesh), volume(target.mesh), 1e-3);
    for (std::size_t i = 1; i < found.size(); ++i) EXPECT_LE(found[i].share, found[i - 1].share);
  }
}

TEST(Setup, ARegisteredRepairIsLeftWhereItIs) {
  const LoadedPart initial = part(*boolean_difference(step(), box(25, -1, 5, 31, 13, 9)));
  const LoadedPart target = part(step());
  std::vector<std::string> why;
  const auto found = place_target(initial, target, rig(), Setup::kSearch, why);
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].setup, "stored");
  EXPECT_TRUE(found[0].placement.rotation.isIdentity(0));
}

TEST(Setup, SameInputSamePoses) {
  const LoadedPart initial = part(box(0, 0, 0, 20, 20, 15)), target = part(step());
  std::vector<std::string> why;
  const auto one = place_target(initial, target, rig(), Setup::kSearch, why);
  const auto two = place_target(initial, target, rig(), Setup::kSearch, why);
  ASSERT_EQ(one.size(), two.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].mesh.vertices, two[i].mesh.vertices);
    EXPECT_EQ(one[i].share, two[i].share);
  }
}

TEST(Setup, ThePublishedProcedureStandsTheTargetOnTheBase) {
  const LoadedPart initial = part(box(0, 0, 0, 30, 30, 30)), target = part(step());
  std::vector<std::string> why;
  const auto found = place_target(initial, target, rig(), Setup::kPaper, why);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].setup, "paper");
  EXPECT_NEAR(bounds(found[0].mesh).min().z(), 0, 1e-9);
  EXPECT_NEAR(volume(found[0].mesh), volume(target.mesh), 1e-2);
  EXPECT_GT(common_share(initial.mesh, found[0].mesh).standing, 0.5);
}

TEST(Setup, OnVolumeAloneThePublishedProcedureSharesMore) {
  const LoadedPart initial = part(box(0, 0, 0, 40, 14, 10)), target = part(step());
  const PoseSampler sampler(initial.mesh, target.in_file);
  const auto anywhere = [](const Box3&) { return true; };
  const auto by_volume = paper_pose(sampler, initial, target, {1, 0}, anywhere);
  const auto by_shape = paper_pose(sampler, initial, target, {0, 1}, anywhere);
  ASSERT_TRUE(by_volume && by_shape);
  EXPECT_GT(sampler.share(*by_volume), sampler.share(*by_shape));
}

TEST(Setup, WhereNothingFitsTheReasonIsSaid) {
  const LoadedPart initial = part(box(0, 0, 0, 30, 30, 30));
  const LoadedPart target = part(box(0, 0, 5, 10, 10, 15));
  std::vector<std::string> why;
  EXPECT_TRUE(place_target(initial, target, rig(), Setup::kStored, why).empty());
  ASSERT_EQ(why.size(), 1u);
  EXPECT_NE(why[0].find("5.0"), std::string::npos) << why[0];
}

TEST(PoseSampler, ABaseIsWhereTheInitialSurfaceLiesInsideTheTarget) {
  // The target stands higher: its base is the top of the block under it.
  const LoadedPart initial = part(box(-10, -10, 0, 10, 10, 12));
  const LoadedPart target = part(box(-5, -5, 0, 5, 5, 20));
  const PoseSampler sampler(initial.mesh, target.in_file);
  const Pose pose{Eigen::Matrix3d::Identity(), target.placement.translation};
  const PoseBase base = sampler.base(pose);
  EXPECT_NEAR(base.area_mm2, 200, 15);  // the top, and the bottom that both share
  EXPECT_NEAR(base.highest_z, 12, 0.5);
  EXPECT_NEAR(sampler.share(pose), 0.6, 0.02);
}

TEST(CommonShare, WhatHangsInTheAirDoesNotStand) {
  const auto table = *boolean_union(box(0, 0, 0, 5, 20, 10), box(0, 0, 10, 30, 20, 15));
  const auto posts = *boolean_union(box(0, 0, 0, 2, 20, 15), box(20, 0, 0, 30, 20, 15));
  // Common: the post at x = 0 to 2, and a block under x = 20 to 30 from z = 10 on.
  const CommonShare share = common_share(table, posts);
  EXPECT_NEAR(share.all, (2. * 15 + 10 * 5) / (12 * 15), 0.01);
  EXPECT_NEAR(share.standing, 2. * 15 / (12 * 15), 0.01);
}

TEST(ConvexHull, OfABoxHasItsEightCorners) {
  auto points = box(0, 0, 0, 3, 4, 5).vertices;
  points.emplace_back(1, 1, 1);
  const TriangleMesh hull = convex_hull(points);
  EXPECT_EQ(hull.vertices.size(), 8u);
  EXPECT_DOUBLE_EQ(volume(hull), 60);
  EXPECT_TRUE(convex_hull(std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}).empty());
}

TEST(ConvexHull, ASolidRestsOnlyOnSidesUnderItsCentreOfGravity) {
  // A slanted column tips over on its ends.
  TriangleMesh column = box(0, 0, 0, 4, 4, 30);
  for (Vec3& vertex : column.vertices) vertex.x() += 0.5 * vertex.z();
  const auto sides = resting_sides(convex_hull(column.vertices), centre_of_gravity(column), 0.005);
  ASSERT_EQ(sides.size(), 4u);
  for (const RestingSide& side : sides) EXPECT_LT(std::abs(side.down.z()), 0.5);
  EXPECT_NEAR((centre_of_gravity(column) - Vec3(9.5, 2, 15)).norm(), 0, 1e-6);
  // All but its top, and the slanted side of its hull as well.
  EXPECT_EQ(resting_sides(convex_hull(step().vertices), centre_of_gravity(step()), 0.005).size(),
            6u);
}

}  // namespace
}  // namespace reforge

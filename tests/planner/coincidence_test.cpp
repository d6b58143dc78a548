#include "planner/reuse/coincidence.h"

#include <gtest/gtest.h>

#include "planner/geometry/shapes.h"
#include "planner/geometry/triangle_tree.h"

namespace reforge {
namespace {

constexpr double kTolerance = 0.02;

double lowest_side(const TriangleMesh& mesh, const Vec3& normal) {
  double lowest = std::numeric_limits<double>::infinity();
  for (const Vec3& vertex : mesh.vertices) lowest = std::min(lowest, normal.dot(vertex));
  return lowest;
}

TEST(TriangleTree, ClosestPointLiesOnTheNearestFace) {
  const TriangleMesh box = make_box(Vec3(0, 0, 0), Vec3(10, 10, 10));
  const TriangleTree tree(box);
  const auto above = tree.closest(Vec3(3, 4, 12), 5);
  ASSERT_TRUE(above);
  EXPECT_NEAR((above->point - Vec3(3, 4, 10)).norm(), 0, 1e-12);
  EXPECT_NEAR(above->distance, 2, 1e-12);
  const auto corner = tree.closest(Vec3(11, 11, 11), 5);
  ASSERT_TRUE(corner);
  EXPECT_NEAR(corner->distance, std::sqrt(3.0), 1e-12);
  EXPECT_FALSE(tree.closest(Vec3(3, 4, 12), 1.9));
}

TEST(TriangleTree, FacingLeavesOutOtherSides) {
  const TriangleMesh box = make_box(Vec3(0, 0, 0), Vec3(10, 10, 10));
  const TriangleTree tree(box);
  const auto side = tree.closest_facing(Vec3(9, 5, 9.5), 5, {Vec3::UnitX(), 0.9});
  ASSERT_TRUE(side);
  EXPECT_NEAR(side->distance, 1, 1e-12);
  EXPECT_FALSE(tree.closest_facing(Vec3(5, 5, 9.5), 1, {-Vec3::UnitZ(), 0.9}));
}

TEST(TriangleTree, ContainsAgreesWithTheShape) {
  const TriangleMesh cylinder = make_cylinder(Vec3(0, 0, 0), Vec3(0, 0, 5), 4, 32);
  const TriangleTree tree(cylinder);
  EXPECT_TRUE(tree.contains(Vec3(0, 0, 2)));
  EXPECT_TRUE(tree.contains(Vec3(3.8, 0, 4.99)));
  EXPECT_FALSE(tree.contains(Vec3(0, 0, 5.01)));
  EXPECT_FALSE(tree.contains(Vec3(3.9, 3.9, 2)));
}

TEST(TriangleTree, PairsThatMeetAreVisitedAndDistantOnesAreNot) {
  const TriangleMesh a = make_box(Vec3(0, 0, 0), Vec3(10, 10, 10));
  const TriangleMesh b = make_box(Vec3(5, 5, 5), Vec3(6, 6, 20));
  const TriangleMesh inside = make_box(Vec3(5, 5, 5), Vec3(6, 6, 6));
  int meeting = 0, apart = 0;
  TriangleTree::visit_pairs(TriangleTree(a), TriangleTree(b), [&](auto, auto) { ++meeting; });
  TriangleTree::visit_pairs(TriangleTree(a), TriangleTree(inside), [&](auto, auto) { ++apart; });
  EXPECT_GE(meeting, 8);  // four sides of the bar through the top
  EXPECT_EQ(apart, 0);
}

TEST(Coincidence, DistantSurfacesStayWhereTheyAre) {
  const TriangleMesh block = make_box(Vec3(0, 0, 0), Vec3(10, 10, 10));
  const TriangleMesh part = make_box(Vec3(1, 1, 1), Vec3(9, 9, 9));
  const Separation separation = separate(block, part, kTolerance);
  EXPECT_EQ(separation.coincident_area_mm2, 0);
  EXPECT_EQ(separation.grown.vertices, part.vertices);
  EXPECT_EQ(separation.shrunk.vertices, part.vertices);
}

TEST(Coincidence, ACommonSideIsMovedToBothSidesOfItself) {
  const TriangleMesh block = make_box(Vec3(0, 0, 0), Vec3(10, 10, 10));
  const TriangleMesh part =
      make_box(Vec3(2, 2, 0.001), Vec3(8, 8, 5));  // stands in the block's base
  const Separation separation = separate(block, part, kTolerance);
  EXPECT_LT(lowest_side(separation.grown, Vec3::UnitZ()), 0);
  EXPECT_GT(lowest_side(separation.shrunk, Vec3::UnitZ()), 0.001);
  EXPECT_GT(lowest_side(separation.grown, Vec3::UnitZ()), -kTolerance);
  EXPECT_LT(lowest_side(separation.shrunk, Vec3::UnitZ()), kTolerance);
  EXPECT_NEAR(separation.greatest_distance_mm, 0.001, 1e-9);
  // The walls slide in themselves: the rim moves neither in nor out.
  EXPECT_NEAR(lowest_side(separation.grown, Vec3::UnitX()), 2, 1e-6);
  EXPECT_NEAR(lowest_side(separation.shrunk, Vec3::UnitX()), 2, 1e-6);
}

TEST(Coincidence, IdenticalSolidsAreHeldApartEverywhere) {
  const TriangleMesh part = make_cylinder(Vec3(0, 0, 0), Vec3(0, 0, 5), 4, 64);
  const Separation separation = separate(part, part, kTolerance);
  EXPECT_NEAR(separation.coincident_area_mm2, area(part), 1e-9);
  const TriangleTree grown(separation.grown), shrunk(separation.shrunk);
  for (const Vec3& vertex : part.vertices) {
    EXPECT_TRUE(grown.contains(vertex));
    EXPECT_FALSE(shrunk.contains(vertex));
  }
}

TEST(Coincidence, BackToBackBothVersionsStandBack) {
  const TriangleMesh left = make_box(Vec3(0, 0, 0), Vec3(10, 10, 10));
  const TriangleMesh right = make_box(Vec3(10, 0, 0), Vec3(20, 10, 10));
  const Separation separation = separate(left, right, kTolerance);
  EXPECT_GT(lowest_side(separation.grown, Vec3::UnitX()), 10);
  EXPECT_GT(lowest_side(separation.shrunk, Vec3::UnitX()), 10);
}

TEST(Coincidence, CornersInTheMiddleOfALargeTriangleAreFound) {
  const TriangleMesh pad = make_box(Vec3(7, 1, 0), Vec3(8, 2, 5));  // flush with the plate's base
  const TriangleMesh plate = make_box(Vec3(0, 0, 0), Vec3(10, 10, 2));
  const Separation separation = separate(pad, plate, kTolerance);
  EXPECT_GE(separation.target.vertices.size(), plate.vertices.size() + 4);
  EXPECT_NEAR(volume(separation.target), volume(plate), 1e-9);
  EXPECT_LT(lowest_side(separation.grown, Vec3::UnitZ()), 0);
}

}  // namespace
}  // namespace reforge

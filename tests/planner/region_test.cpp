#include "planner/toolpath/region.h"

#include <gtest/gtest.h>

#include "planner/toolpath/level_region.h"

namespace reforge {
namespace {

TEST(Region, AreasOfHolesAreTakenAway) {
  const PlaneRegion plate = without(rectangle({0, 0}, {10, 10}), rectangle({2, 2}, {4, 5}));
  EXPECT_NEAR(area(plate), 94, 1e-6);
  EXPECT_TRUE(contains(plate, {1, 1}));
  EXPECT_FALSE(contains(plate, {3, 3}));
}

TEST(Region, ShrinkingASquareMovesEverySide) {
  EXPECT_NEAR(area(offset(rectangle({0, 0}, {10, 10}), -1)), 64, 1e-6);
  EXPECT_TRUE(offset(rectangle({0, 0}, {1, 10}), -0.6).empty());
}

TEST(Region, IslandsKeepTheirHoles) {
  const PlaneRegion ring = without(rectangle({0, 0}, {10, 10}), rectangle({3, 3}, {7, 7}));
  const std::vector<PlaneRegion> parts = islands(united(ring, rectangle({20, 0}, {21, 1})));
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_NEAR(area(parts[0]) + area(parts[1]), 85, 1e-6);
}

TEST(Region, LinesAreCutInOrderAndKeepTheirSense) {
  const PlaneRegion two = united(rectangle({0, 0}, {1, 1}), rectangle({2, 0}, {3, 1}));
  const auto pieces = inside({{{4, 0.5}, {-1, 0.5}}}, two);
  ASSERT_EQ(pieces.size(), 2u);
  EXPECT_NEAR(pieces[0].front().x(), 3, 1e-4);
  EXPECT_NEAR(pieces[0].back().x(), 2, 1e-4);
  EXPECT_NEAR(pieces[1].front().x(), 1, 1e-4);
}

TEST(Region, SimplifyingKeepsTheToleranceAndTheCorners) {
  Polyline line;
  for (int i = 0; i <= 100; ++i) line.emplace_back(0.1 * i, i % 2 ? 0.001 : 0);
  line.emplace_back(10, 5);
  EXPECT_EQ(simplified(line, 0.005, false).size(), 3u);
  const Polyline square{{0, 0}, {5, 0}, {10, 0}, {10, 10}, {0, 10}};
  EXPECT_EQ(simplified(square, 0.005, true).size(), 4u);
}

TEST(LevelRegion, DiscHasItsAreaAndItsHole) {
  const PlaneGrid grid = PlaneGrid::covering({-6, -6}, {6, 6}, 0.3);
  const auto rule = [](const Vec2& p) { return p.norm() < 5 && p.norm() > 2; };
  std::vector<char> nodes(grid.size());
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) nodes[grid.index(c, r)] = rule(grid.node(c, r));
  }
  const PlaneRegion ring = region_where(grid, nodes, rule);
  EXPECT_EQ(ring.rings.size(), 2u);
  EXPECT_NEAR(area(ring), 3.14159265 * 21, 0.2);
  for (const Polyline& line : ring.rings) {
    for (const Vec2& p : line) EXPECT_TRUE(rule(p) || p.norm() < 5.002);
  }
}

}  // namespace
}  // namespace reforge

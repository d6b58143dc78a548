// A ball lowered onto simple solids, against heights computed by hand.
#include "planner/toolpath/offset_surface.h"

#include <gtest/gtest.h>

#include <cmath>

#include "planner/geometry/shapes.h"

namespace reforge {
namespace {

const Frame kUp = Frame::along(Vec3::UnitZ());

TEST(OffsetSurface, BallRestsOnAFlatTop) {
  const OffsetSurface s(make_box({0, 0, 0}, {10, 10, 4}), kUp, 1.5);
  EXPECT_NEAR(s.centre(5, 5), 5.5, 1e-12);
  EXPECT_NEAR(s.contact(3, 7).normal.z(), 1, 1e-12);
}

TEST(OffsetSurface, BallRollsOverAnEdgeAndACorner) {
  const OffsetSurface s(make_box({0, 0, 0}, {10, 10, 4}), kUp, 1.5);
  EXPECT_NEAR(s.centre(10.9, 5), 4 + std::sqrt(1.5 * 1.5 - 0.81), 1e-12);
  EXPECT_NEAR(s.centre(10.6, 10.8), 4 + std::sqrt(2.25 - 0.36 - 0.64), 1e-12);
}

TEST(OffsetSurface, NothingBelowBeyondTheRadius) {
  const OffsetSurface s(make_box({0, 0, 0}, {10, 10, 4}), kUp, 1.5);
  EXPECT_EQ(s.centre(11.5001, 5), kNothingBelow);
  EXPECT_EQ(s.centre(100, 5), kNothingBelow);
}

TEST(OffsetSurface, SlopeLiftsTheCentreByTheSecant) {
  // A ridge: a box turned by 45 degrees about y, its top edge at (0, y, h).
  const double h = 5 * std::sqrt(2.0);
  const Frame turned = Frame::along(Vec3(std::sqrt(0.5), 0, std::sqrt(0.5)));
  const OffsetSurface s(make_box({-5, -20, -5}, {5, 20, 5}), turned, 1.5);
  // Along (1, 0, 1)/sqrt2 the box shows its edge; v runs across it.
  EXPECT_NEAR(s.centre(0, 0), h + 1.5, 1e-9);
  EXPECT_NEAR(s.centre(0, 3), h - 3 + 1.5 * std::sqrt(2.0), 1e-9);
}

TEST(OffsetSurface, AgreesWithBruteForceOverACylinder) {
  const TriangleMesh bar = make_cylinder({-10, 0, 3}, {10, 0, 3}, 2, 200);
  const OffsetSurface s(bar, kUp, 1.5);
  for (double v = -3.4; v < 3.4; v += 0.17) {
    EXPECT_NEAR(s.centre(1, v), 3 + std::sqrt(3.5 * 3.5 - v * v), 2e-3) << v;
  }
}

TEST(OffsetSurface, OverhangKeepsTheShankOut) {
  TriangleMesh shelf = make_box({0, 0, 0}, {10, 10, 1});
  const TriangleMesh roof = make_box({0, 0, 8}, {4, 10, 9});
  const auto first = static_cast<std::uint32_t>(shelf.vertices.size());
  shelf.vertices.insert(shelf.vertices.end(), roof.vertices.begin(), roof.vertices.end());
  for (const auto& t : roof.triangles)
    shelf.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  const OffsetSurface s(shelf, kUp, 1.5);
  EXPECT_NEAR(s.centre(2, 5), 10.5, 1e-12);
  EXPECT_GT(s.centre(5.4, 5), 9);
  EXPECT_NEAR(s.centre(6, 5), 2.5, 1e-12);
}

}  // namespace
}  // namespace reforge

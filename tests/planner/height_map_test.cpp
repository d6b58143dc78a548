#include "planner/geometry/height_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "planner/geometry/shapes.h"

namespace reforge {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

HeightMap random_map(std::mt19937& random, int columns, int rows, double pitch) {
  HeightGrid grid;
  grid.frame = Frame::along(Vec3::UnitZ());
  grid.pitch_mm = pitch;
  grid.columns = columns;
  grid.rows = rows;
  HeightMap map(grid);
  for (float& height : map.heights) {
    if (random() % 4 != 0) height = static_cast<float>(random() % 1000) / 10;
  }
  return map;
}

TEST(HeightMap, FrameAlongUpIsThePartFrame) {
  const Frame frame = Frame::along(Vec3::UnitZ());
  EXPECT_EQ(frame.u, Vec3::UnitX());
  EXPECT_EQ(frame.v, Vec3::UnitY());
}

TEST(HeightMap, FrameIsRightHandedAndReturns) {
  for (const Vec3& d : {Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0.6, 0, 0.8), Vec3(-0.48, 0.64, 0.6)}) {
    const Frame frame = Frame::along(d);
    EXPECT_NEAR(frame.u.cross(frame.v).dot(d), 1, 1e-12);
    EXPECT_NEAR((frame.to_part(frame.to_local(Vec3(1, 2, 3))) - Vec3(1, 2, 3)).norm(), 0, 1e-12);
  }
}

TEST(HeightMap, EnvelopeOfABoxIsItsTopWhereItsCentresAre) {
  const auto box = make_box(Vec3(0, 0, 0), Vec3(4, 3, 7));
  const auto grid = HeightGrid::over(Frame::along(Vec3::UnitZ()), 0.5, bounds(box), 2);
  const auto map = upper_envelope(grid, box, Sampling::kCentres);
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const Vec3 at = grid.centre(column, row, 0);
      const bool over = at.x() > 0 && at.x() < 4 && at.y() > 0 && at.y() < 3;
      EXPECT_EQ(map.at(column, row), over ? 7.0f : HeightMap::kEmpty);
    }
  }
}

TEST(HeightMap, EnvelopeOfATiltedSphereLikeSolidMatchesRaysThroughItsFacets) {
  const auto solid = make_cylinder(Vec3(1, 2, 0), Vec3(4, 1, 9), 3, 17);
  const Frame frame = Frame::along(Vec3(0.48, -0.6, 0.64));
  const auto grid = HeightGrid::over(frame, 0.37, solid.vertices, 1);
  const auto map = upper_envelope(grid, solid, Sampling::kCentres);
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      double highest = -kInfinite;  // by barycentric coordinates over every triangle
      const double u = grid.u0 + column * grid.pitch_mm, v = grid.v0 + row * grid.pitch_mm;
      for (const auto& t : solid.triangles) {
        const Vec3 a = frame.to_local(solid.vertices[t[0]]);
        const Vec3 b = frame.to_local(solid.vertices[t[1]]);
        const Vec3 c = frame.to_local(solid.vertices[t[2]]);
        Eigen::Matrix3d m;
        m << a.x(), b.x(), c.x(), a.y(), b.y(), c.y(), 1, 1, 1;
        if (std::abs(m.determinant()) < 1e-9) continue;
        const Vec3 weight = m.inverse() * Vec3(u, v, 1);
        if (weight.minCoeff() < -1e-9) continue;
        highest = std::max(highest, weight.dot(Vec3(a.z(), b.z(), c.z())));
      }
      if (std::isinf(highest)) {
        EXPECT_EQ(map.at(column, row), HeightMap::kEmpty);
      } else {
        EXPECT_NEAR(map.at(column, row), highest, 1e-4);
      }
    }
  }
}

TEST(HeightMap, ConservativeEnvelopeIsNowhereBelowAFinerOne) {
  const auto solid = make_cylinder(Vec3(1, 2, 0), Vec3(4, 1, 9), 3, 17);
  const Frame frame = Frame::along(Vec3(0.48, -0.6, 0.64));
  const auto coarse =
      upper_envelope(HeightGrid::over(frame, 1, solid.vertices, 1), solid, Sampling::kConservative);
  const auto fine_grid = HeightGrid::over(frame, 0.0625, solid.vertices, 0);
  const auto fine = upper_envelope(fine_grid, solid, Sampling::kCentres);
  for (int row = 0; row < fine_grid.rows; ++row) {
    for (int column = 0; column < fine_grid.columns; ++column) {
      EXPECT_GE(coarse.lookup(fine_grid.centre(column, row, 0)), fine.at(column, row) - 1e-4f);
    }
  }
}

TEST(HeightMap, DilationByADiscIsTheMaximumOverEveryCellNearerThanItsRadius) {
  std::mt19937 random(7);
  for (const double radius : {0.2, 0.5, 1.0, 1.3, 2.75, 9.0}) {
    const auto map = random_map(random, 23, 17, 0.5);
    const auto fast = dilated(map, radius);
    for (int row = 0; row < 17; ++row) {
      for (int column = 0; column < 23; ++column) {
        float highest = HeightMap::kEmpty;
        for (int y = 0; y < 17; ++y) {
          for (int x = 0; x < 23; ++x) {
            if (0.5 * std::hypot(x - column, y - row) < radius) {
              highest = std::max(highest, map.at(x, y));
            }
          }
        }
        EXPECT_EQ(fast.at(column, row), highest) << radius;
      }
    }
  }
}

TEST(HeightMap, TipHeightsOfAToolAreWhereItWouldFirstTouch) {
  std::mt19937 random(11);
  const std::vector<ToolSection> tool{
      {0.2, 5, 1, 1}, {5, 9, 2, 4}, {9, kInfinite, kInfinite, kInfinite}};
  const auto map = random_map(random, 21, 19, 0.7);
  const auto tips = tip_heights(map, tool);
  for (int row = 0; row < 19; ++row) {
    for (int column = 0; column < 21; ++column) {
      double tip = -kInfinite;
      for (int y = 0; y < 19; ++y) {
        for (int x = 0; x < 21; ++x) {
          const double distance = 0.7 * std::hypot(x - column, y - row);
          double underside = 9;
          if (distance < 1)
            underside = 0.2;
          else if (distance < 2)
            underside = 5;
          else if (distance < 4)
            underside = 5 + 4 * (distance - 2) / 2;
          tip = std::max(tip, map.at(x, y) - underside);
        }
      }
      EXPECT_NEAR(tips.at(column, row), tip, 1e-4);
    }
  }
}

TEST(HeightMap, ABallRestsOnAFlatTopAndRollsOffItsEdge) {
  const auto box = make_box(Vec3(0, 0, 0), Vec3(10, 10, 5));
  const auto grid = HeightGrid::over(Frame::along(Vec3::UnitZ()), 0.1, bounds(box), 3);
  const auto tips = tip_heights_of_ball(upper_envelope(grid, box, Sampling::kCentres), 1.5);
  EXPECT_NEAR(tips.lookup(Vec3(5, 5, 0)), 5, 1e-5);
  EXPECT_NEAR(tips.lookup(Vec3(10.95, 5, 0)), 5 - 1.5 + std::sqrt(1.5 * 1.5 - 1), 0.05);
  EXPECT_EQ(tips.lookup(Vec3(11.8, 5, 0)), HeightMap::kEmpty);
}

}  // namespace
}  // namespace reforge

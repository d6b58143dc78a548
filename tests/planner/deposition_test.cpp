// Beads of blocks whose volume and shape are known.
#include "planner/toolpath/deposition.h"

#include <gtest/gtest.h>

#include <numbers>

#include "planner/geometry/shapes.h"
#include "planner/toolpath/bead_layout.h"
#include "planner/toolpath/slicing.h"

namespace reforge {
namespace {

const Frame kUp = Frame::along(Vec3::UnitZ());

DepositionOptions options_for_tests() {
  DepositionOptions options;
  options.extrusion.bead_width_mm = 0.5;
  options.extrusion.layer_height_mm = 0.2;
  options.extrusion.infill = 0.3;
  options.extrusion.coast_mm = 0.2;
  options.nozzle.body = {{0.2, 5, 1, 1}, {5, 20, 4.5, 4.5}, {20, 110, 18, 18}};
  return options;
}

Deposition printed(const TriangleMesh& block, const std::vector<const TriangleMesh*>& ground,
                   std::vector<const TriangleMesh*> obstacles = {}) {
  obstacles.insert(obstacles.end(), ground.begin(), ground.end());
  return deposit(options_for_tests(), block, kUp, {ground, {}, obstacles}, [] { return false; });
}

double length_at(const std::vector<Bead>& beads) {
  double sum = 0;
  for (const Bead& bead : beads) sum += length_of(bead.line, bead.closed);
  return sum;
}

TEST(Slicing, BoxGivesItsSectionInEveryLayer) {
  const Slices slices = slice(make_box({0, 0, 5}, {10, 4, 7}), kUp, 0.2);
  ASSERT_EQ(slices.layers.size(), 10u);
  EXPECT_NEAR(slices.base, 5, 1e-12);
  EXPECT_NEAR(slices.top_of(0), 5.2, 1e-12);
  for (const PlaneRegion& layer : slices.layers) EXPECT_NEAR(area(layer), 40, 1e-3);
}

TEST(Slicing, VolumeOfSlicesIsThatOfTheSolid) {
  const TriangleMesh bar = make_cylinder({0, 0, 0}, {10, 5, 8}, 4, 60);
  const Slices slices = slice(bar, kUp, 0.2);
  double sum = 0;
  for (const PlaneRegion& layer : slices.layers) sum += area(layer) * 0.2;
  EXPECT_NEAR(sum / volume(bar), 1, 0.003);
}

TEST(Slicing, SidewaysFrameCutsAcross) {
  EXPECT_NEAR(area(section(make_box({0, 0, 0}, {10, 4, 2}), Frame::along(Vec3::UnitX()), 5)), 8,
              1e-4);
}

TEST(BeadLayout, WallsAndInfillFillTheirShare) {
  const PlaneRegion square = rectangle({0, 0}, {20, 20});
  const BeadOptions options;
  const double inside = 18 * 18;
  const double sparse = length_at(lay_beads(square, {}, false, options)) * 0.5;
  EXPECT_NEAR(sparse / (400 - inside + 0.3 * inside), 1, 0.03);
  const double whole = length_at(lay_beads(square, square, false, options)) * 0.5;
  EXPECT_NEAR(whole / 400, 1, 0.04);
}

TEST(BeadLayout, NarrowRibKeepsOneLine) {
  const std::vector<Bead> beads = lay_beads(rectangle({0, 0}, {0.4, 10}), {}, false, {});
  ASSERT_EQ(beads.size(), 1u);
  EXPECT_FALSE(beads[0].closed);
  EXPECT_NEAR(length_of(beads[0].line, false), 9.5, 0.6);
  for (const Vec2& p : beads[0].line) EXPECT_NEAR(p.x(), 0.2, 0.1);
}

TEST(BeadLayout, NarrowRingKeepsOneLoop) {
  Polyline outer, inner;
  for (int i = 0; i < 90; ++i) {
    const double a = 2 * std::numbers::pi * i / 90;
    outer.emplace_back(5 * std::cos(a), 5 * std::sin(a));
    inner.emplace_back(4.6 * std::cos(a), 4.6 * std::sin(a));
  }
  const std::vector<Bead> beads = lay_beads(without({{outer}}, {{inner}}), {}, false, {});
  ASSERT_EQ(beads.size(), 1u);
  EXPECT_TRUE(beads[0].closed);
  EXPECT_NEAR(length_of(beads[0].line, true), 2 * std::numbers::pi * 4.8, 0.3);
}

TEST(Deposition, BoxOnABoxIsPrintedWhole) {
  const TriangleMesh base = make_box({0, 0, 0}, {20, 20, 10}),
                     block = make_box({2, 2, 10}, {18, 18, 14});
  const Deposition d = printed(block, {&base});
  EXPECT_EQ(d.layers, 20);
  EXPECT_NEAR(d.unsupported_mm3, 0, 0.5);
  EXPECT_NEAR(d.blocked_mm3, 0, 0.5);
  EXPECT_NEAR(d.bead_mm3 / d.planned_mm3, 1, 0.03);
  EXPECT_NEAR(d.paths.front().moves.back().to.z(), 10.2, 1e-9);
  EXPECT_TRUE(d.paths.front().first_layer);
  EXPECT_FALSE(d.paths.back().first_layer);
}

TEST(Deposition, TravelsRiseAndBeadsStayInTheirLayer) {
  const TriangleMesh base = make_box({0, 0, 0}, {20, 20, 10}),
                     block = make_box({2, 2, 10}, {18, 18, 12});
  const Deposition d = printed(block, {&base});
  for (size_t i = 0; i < d.paths.size(); ++i) {
    const std::vector<Move>& moves = d.paths[i].moves;
    double layer = 0, coast = 0;
    for (size_t k = 0; k < moves.size(); ++k) {
      if (moves[k].motion == Motion::kDeposit) layer = moves[k].to.z();
      if (moves[k].motion == Motion::kCoast) coast += (moves[k].to - moves[k - 1].to).norm();
    }
    EXPECT_NEAR(coast, 0.2, 1e-6);
    for (size_t k = 1; k + 1 < moves.size(); ++k) {
      // Sideways at G0 only above the layer.
      if (moves[k].motion == Motion::kRapid &&
          (moves[k].to - moves[k - 1].to).head<2>().norm() > 1e-9) {
        EXPECT_GT(moves[k].to.z(), layer + 0.4);
      }
    }
  }
}

TEST(Deposition, ShelfInTheAirIsLeftOutAndCounted) {
  // A shelf that juts out 10 mm at half height.
  const TriangleMesh base = make_box({0, 0, 0}, {10, 10, 4});
  TriangleMesh block = make_box({0, 0, 4}, {10, 10, 8});
  const TriangleMesh shelf = make_box({10, 0, 6}, {20, 10, 8});
  const auto first = static_cast<std::uint32_t>(block.vertices.size());
  block.vertices.insert(block.vertices.end(), shelf.vertices.begin(), shelf.vertices.end());
  for (const auto& t : shelf.triangles)
    block.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  const Deposition d = printed(block, {&base});
  // It grows by 0.3 mm a layer: 10 layers reach 3 mm.
  EXPECT_NEAR(d.unsupported_mm3, 200 - 10 * 0.2 * 10 * (0.3 + 3.0) / 2, 12);
}

TEST(Deposition, NozzleKeepsAwayFromAWall) {
  const TriangleMesh base = make_box({0, 0, 0}, {20, 20, 4}),
                     wall = make_box({20, 0, 0}, {24, 20, 30});
  const TriangleMesh block = make_box({10, 0, 4}, {20, 20, 6});
  const Deposition d = printed(block, {&base}, {&wall});
  // The head (radius 18, 20 mm up) stays clear of the wall's top 26 mm above: nothing can be
  // printed within 18 mm of it.
  EXPECT_GT(d.blocked_mm3, 0.95 * volume(block));
  const TriangleMesh low = make_box({20, 0, 0}, {24, 20, 8});
  // A wall that ends below the 4.5 mm body keeps only the tip (radius 1) away.
  const Deposition near = printed(block, {&base}, {&low});
  EXPECT_NEAR(near.blocked_mm3, 1.1 * 20 * 2, 10);
}

TEST(Deposition, IsTheSameEveryTime) {
  const TriangleMesh base = make_box({0, 0, 0}, {9, 9, 4});
  const TriangleMesh block = make_cylinder({4, 4, 4}, {5, 4.5, 9}, 3, 30);
  const Deposition a = printed(block, {&base}), b = printed(block, {&base});
  ASSERT_EQ(a.paths.size(), b.paths.size());
  for (size_t i = 0; i < a.paths.size(); ++i) {
    ASSERT_EQ(a.paths[i].moves.size(), b.paths[i].moves.size());
    for (size_t k = 0; k < a.paths[i].moves.size(); ++k) {
      EXPECT_EQ(a.paths[i].moves[k].to, b.paths[i].moves[k].to);
    }
  }
}

}  // namespace
}  // namespace reforge

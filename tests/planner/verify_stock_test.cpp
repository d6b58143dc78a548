// Swept volumes that can be written down: slot, boss, tilted wall, bead.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "planner/geometry/shapes.h"
#include "planner/verify/block_stock.h"

namespace reforge::verify {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDepth = 0.02;  // mm: what must be reached in depth

View view_along(const Vec3& direction, const TriangleMesh& mesh, double pitch = 0.1) {
  return make_view(direction, mesh.vertices, 1.0, pitch);
}

// Highest material on the line x, y of the part frame after the stock's layers.
double top_at(const Stock& stock, const TriangleMesh& mesh, double x, double y) {
  const View view = view_along(Vec3::UnitZ(), mesh);
  const Material material = stock.columns(view);
  const int i = static_cast<int>(std::floor((x - view.u0) / view.pitch));
  const int j = static_cast<int>(std::floor((y - view.v0) / view.pitch));
  const auto column = material.original.at(view.cell(i, j));
  return column.empty() ? -INFINITY : static_cast<double>(column.back().hi);
}

TEST(VerifyColumns, VolumesOfSolidsAreTheirOwn) {
  const TriangleMesh box = make_box({-10, -5, 0}, {10, 5, 8});
  EXPECT_NEAR(rasterise(box, view_along({0, 0, 1}, box)).length() * 0.01, 1600, 0.01);
  const TriangleMesh bar = make_cylinder({0, 0, 0}, {20, 0, 0}, 6, 64);
  for (const Vec3& d : {Vec3(0, 0, 1), Vec3(1, 0, 0), Vec3(1, 2, 3)}) {
    const double got = rasterise(bar, view_along(d, bar)).length() * 0.01;
    EXPECT_NEAR(got / volume(bar), 1, 0.002);
  }
}

TEST(VerifyColumns, IntervalsUniteAndSubtract) {
  Intervals a;
  unite(a, {0, 1}, 0);
  unite(a, {2, 3}, 0);
  unite(a, {0.5f, 2.5f}, 0);
  ASSERT_EQ(a.size(), 1u);
  EXPECT_EQ(a[0].hi, 3);
  Intervals out;
  const Intervals holes{{-1, 0.5f}, {1, 1.5f}, {2.5f, 9}};
  subtract(a, holes, out);
  ASSERT_EQ(out.size(), 2u);
  EXPECT_EQ(out[0].lo, 0.5f);
  EXPECT_EQ(out[1].hi, 2.5f);
  EXPECT_DOUBLE_EQ(shared_length(a, holes), 0.5 + 0.5 + 0.5);
}

TEST(VerifyView, SameDirectionIsSameGridAndRoundCoordinatesFallBetweenCentres) {
  const TriangleMesh box = make_box({0, 0, 0}, {10, 10, 10});
  const View view = view_along({0, 0, 1}, box);
  EXPECT_EQ(view, view_along(Vec3(1e-12, 0, 2), box));
  EXPECT_EQ(view.to_view({1, 2, 3}), Vec3(1, 2, 3));
  const double cells = (10.0 - view.u0) / view.pitch;
  EXPECT_NEAR(cells, std::round(cells), 1e-9);
}

// A slot along x, tip at z = 6, ball radius 1.5: floor at 6, at a distance e from the middle
// 7.5 - sqrt(2.25 - e^2).
TEST(VerifyStock, SlotHasTheBallsSection) {
  const TriangleMesh box = make_box({-10, -10, 0}, {10, 10, 10});
  const View view = view_along({0, 0, 1}, box);
  Stock stock(box);
  BlockStock block(view, stock.columns(view));
  block.cut({-15, 0, 6}, {15, 0, 6}, 1.5, 0.05);
  block.close(stock);
  for (const double e : {0.05, 0.55, 1.05, 1.35}) {
    EXPECT_NEAR(top_at(stock, box, 2.0, e), 7.5 - std::sqrt(2.25 - e * e), kDepth) << e;
  }
  EXPECT_NEAR(top_at(stock, box, 2.0, 1.65), 10, 1e-4);
  const double removed = 4000 - stock.columns(view).original.length() * 0.01;
  EXPECT_NEAR(removed, 20 * (3 * 2.5 + kPi * 2.25 / 2), 1.5);
}

// A plunge down a slope: the surface is the tangent cylinder's, not the balls' at the ends.
TEST(VerifyStock, SlopedSlotIsTheTangentSurface) {
  const TriangleMesh box = make_box({-10, -10, 0}, {10, 10, 10});
  const View view = view_along({0, 0, 1}, box);
  Stock stock(box);
  BlockStock block(view, stock.columns(view));
  block.cut({-8, 0, 9}, {8, 0, 5}, 1.5, 0.05);
  block.close(stock);
  const double m = -4.0 / 16.0;
  // Below the centre line by R sqrt(1 + m^2), in the middle of the slot.
  const double expected = (7 + 1.5 + m * 0.05) - 1.5 * std::sqrt(1 + m * m);
  EXPECT_NEAR(top_at(stock, box, 0.05, 0.05), expected, kDepth);
}

// Circles of the ball around a hemispherical boss of radius 4 leave the boss within the scallop.
TEST(VerifyStock, HemisphereBossComesOutRound) {
  const TriangleMesh box = make_box({-8, -8, 0}, {8, 8, 6});
  const View view = view_along({0, 0, 1}, box);
  Stock stock(box);
  BlockStock block(view, stock.columns(view));
  const double boss = 4, ball = 1.5;
  const int rings = 80, sides = 180;
  for (int k = 1; k <= rings; ++k) {
    const double angle = kPi / 2 * k / rings;  // from the pole
    const double ring = (boss + ball) * std::sin(angle);
    const double tip = (boss + ball) * std::cos(angle) - ball + 1.5;
    for (int s = 0; s < sides; ++s) {
      const double p = 2 * kPi * s / sides, q = 2 * kPi * (s + 1) / sides;
      block.cut({ring * std::cos(p), ring * std::sin(p), tip},
                {ring * std::cos(q), ring * std::sin(q), tip}, ball, 0.05);
    }
  }
  block.close(stock);
  for (const double r : {0.5, 1.5, 2.5, 3.5}) {
    const double x = r * std::cos(0.3), y = r * std::sin(0.3);
    const double cx = std::floor(x * 10) / 10 + 0.05, cy = std::floor(y * 10) / 10 + 0.05;
    const double expected = 1.5 + std::sqrt(boss * boss - cx * cx - cy * cy);
    EXPECT_NEAR(top_at(stock, box, cx, cy), expected, kDepth) << r;
  }
}

// A plane milled with the tool tilted by 30 degrees, seen from above afterwards.
TEST(VerifyStock, TiltedWallIsPlaneSeenFromAbove) {
  const TriangleMesh box = make_box({-10, -10, 0}, {10, 10, 10});
  const double tilt = kPi / 6;
  const Vec3 d(std::sin(tilt), 0, std::cos(tilt));
  const View view = view_along(d, box);
  Stock stock(box);
  BlockStock block(view, stock.columns(view));
  const double height = 5;  // the plane d . p = 5
  const Vec3 middle = view.to_view(d * height);
  for (double u = -20; u <= 20; u += 0.1) {
    block.cut({u, -20, middle.z()}, {u, 20, middle.z()}, 1.5, 0.05);
  }
  block.close(stock);
  for (const double x : {-3.95, 0.05, 4.05, 7.95}) {
    const double expected = (height - x * d.x()) / d.z();
    EXPECT_NEAR(top_at(stock, box, x, 1.05), expected, kDepth) << x;
  }
}

TEST(VerifyStock, BeadIsWidthTimesHeightUnderTheNozzle) {
  const TriangleMesh box = make_box({-10, -10, 0}, {10, 10, 2});
  const View view = view_along({0, 0, 1}, box, 0.05);
  Stock stock(box);
  BlockStock block(view, stock.columns(view));
  const Bead bead = block.deposit({-5, 0, 2.2}, {5, 0, 2.2}, 0.5, 0.2);
  EXPECT_EQ(bead.supported, bead.judged);
  EXPECT_FALSE(bead.outside);
  block.close(stock);
  const double volume = stock.columns(view).deposited.length() * 0.05 * 0.05;
  EXPECT_NEAR(volume, 0.2 * (10 * 0.5 + kPi * 0.0625), 0.02);
  EXPECT_NEAR(stock.columns(view).original.length() * 0.05 * 0.05, 800, 0.01);
}

TEST(VerifyStock, BeadInTheAirHasNoSupport) {
  const TriangleMesh box = make_box({-10, -10, 0}, {10, 10, 2});
  const View view = view_along({0, 0, 1}, box);
  Stock stock(box);
  BlockStock block(view, stock.columns(view));
  const Bead bead = block.deposit({-5, 0, 2.5}, {5, 0, 2.5}, 0.5, 0.2);
  EXPECT_GT(bead.judged, 0);
  EXPECT_EQ(bead.supported, 0);
}

// Printed from above, then a slot from the side through part and bead.
TEST(VerifyStock, ASideCutGoesThroughBothMaterials) {
  const TriangleMesh box = make_box({-10, -10, 0}, {10, 10, 2});
  Stock stock(box);
  const View up = view_along({0, 0, 1}, box);
  {
    BlockStock block(up, stock.columns(up));
    for (int layer = 1; layer <= 20; ++layer) {
      for (double y = -2; y <= 2; y += 0.4) {
        block.deposit({-5, y, 2 + 0.2 * layer}, {5, y, 2 + 0.2 * layer}, 0.5, 0.2);
      }
    }
    block.close(stock);
  }
  const double printed = stock.columns(up).deposited.length() * 0.01;
  EXPECT_GT(printed, 4 * 4.5 * 10);
  EXPECT_LT(printed, 4 * 4.5 * 10.5);  // with the stadiums' ends
  const std::array<Vec3, 2> hull{Vec3(-11, -11, -1), Vec3(11, 11, 8)};
  const View side = make_view({1, 0, 0}, hull, 1.0, 0.1);
  {
    BlockStock block(side, stock.columns(side));
    const Vec3 a = side.to_view({0, -15, 2}), b = side.to_view({0, 15, 2});
    block.cut(a, b, 1.5, 0.05);
    block.close(stock);
  }
  const Material after = stock.columns(up);
  // Everything at |z - 2| < 1.5 and x > 0 (rounded by the ball towards x = 0 … 1.5) is gone.
  const std::size_t cell =
      up.cell(static_cast<int>((4.05 - up.u0) / 0.1), static_cast<int>((0.05 - up.v0) / 0.1));
  ASSERT_EQ(after.deposited.at(cell).size(), 1u);
  EXPECT_NEAR(after.deposited.at(cell)[0].lo, 3.5, 0.1);
  ASSERT_EQ(after.original.at(cell).size(), 1u);
  EXPECT_NEAR(after.original.at(cell)[0].hi, 0.5, 0.1);
}

TEST(VerifyEnvelope, GapIsTheSmallestGrowthThatTouches) {
  const TriangleMesh post = make_box({4, -1, 0}, {6, 1, 20});
  const View view = view_along({0, 0, 1}, make_box({-20, -20, 0}, {20, 20, 20}));
  Envelope envelope(post, view);
  // A disc of radius 3 at the origin, below the post's top: 1 mm beside it.
  EXPECT_NEAR(envelope.gap({{0, 0, 10}, {0, 0, 10}, 3}, 10), 1, 0.1);
  // Above it: the vertical gap.
  EXPECT_NEAR(envelope.gap({{5, 0, 22}, {5, 0, 22}, 3}, 10), 2, 1e-4);
  // In it.
  EXPECT_NEAR(envelope.gap({{0, 0, 10}, {9, 0, 10}, 3}, 10), -3, 0.15);
  EXPECT_NEAR(envelope.gap({{0, 0, 10}, {0, 0, 10}, INFINITY}, 10), -10, 1e-4);
}

TEST(VerifyEnvelope, BodiesSeeWhatWasCutAway) {
  const TriangleMesh box = make_box({-10, -10, 0}, {10, 10, 10});
  const View view = view_along({0, 0, 1}, box);
  Stock stock(box);
  BlockStock block(view, stock.columns(view));
  EXPECT_NEAR(block.envelope().gap({{0, 0, 9}, {0, 0, 9}, 2}, 10), -1, 1e-4);
  for (double y = -4; y <= 4; y += 0.2) block.cut({-4, y, 5}, {4, y, 5}, 1.5, 0.05);
  EXPECT_NEAR(block.envelope().gap({{0, 0, 9}, {0, 0, 9}, 2}, 10), 3, 0.3);
}

// A cut stops at the air gap: what is lower is untouched, and the envelope knows.
TEST(VerifyEnvelope, KnowsTheMaterialBelowAnOverhang) {
  TriangleMesh two = make_box({-10, -10, 0}, {10, 10, 2});
  const TriangleMesh lid = make_box({-10, -10, 8}, {10, 10, 10});
  for (const Vec3& v : lid.vertices) two.vertices.push_back(v);
  for (auto t : lid.triangles) {
    for (auto& corner : t) corner += 8;
    two.triangles.push_back(t);
  }
  const View view = view_along({0, 0, 1}, two);
  Stock stock(two);
  BlockStock block(view, stock.columns(view));
  for (double y = -6; y <= 6; y += 0.2) block.cut({-6, y, 5}, {6, y, 5}, 1.5, 0.05);
  EXPECT_NEAR(block.envelope().gap({{0, 0, 4}, {0, 0, 4}, 1}, 10), 2, 1e-3);
}

}  // namespace
}  // namespace reforge::verify

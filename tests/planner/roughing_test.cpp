// Roughing of shapes a reader can see: a step, a closed pocket, a wall the holder cannot pass.
#include "planner/toolpath/roughing.h"

#include <gtest/gtest.h>

#include "tests/planner/milling_checks.h"

namespace reforge {
namespace {

using namespace milling_checks;

struct Roughed {
  std::vector<Path> paths;
  double left_mm3;  // rest voxels that are not the skin left to finishing
  double removed_mm3;
};

Roughed roughed(const TriangleMesh& initial, const TriangleMesh& reused, const Vec3& direction,
                const MillingOptions& options, const TriangleMesh& fixture = {}) {
  PartStock stock = part_stock(initial, reused, 2e5);
  const Surroundings solids{initial, reused, fixture};
  BlockStock block(stock, solids, Frame::along(direction), options.cutter);
  Roughed result;
  result.paths = rough(
      options, solids, [] { return false; }, block);
  result.removed_mm3 = stock.volume_mm3(block.commit(stock));
  BitSet rest = stock.rest();
  rest.subtract(stock.near_keep);
  result.left_mm3 = stock.volume_mm3(rest);
  return result;
}

// A box of 20 x 20 x 20 that keeps x < 10 whole and 8 mm of height elsewhere.
const TriangleMesh kBlock = make_box({0, 0, 0}, {20, 20, 20});
const TriangleMesh kStep =
    joined(make_box({0, 0, 0}, {10, 20, 20}), make_box({10, 0, 0}, {20, 20, 8}));

TEST(Roughing, StepIsClearedWithoutGougeOrPlunge) {
  const MillingOptions options = options_for_tests();
  const Roughed r = roughed(kBlock, kStep, Vec3::UnitZ(), options);
  // The allowance stays, but for the sagitta of chords along corners.
  EXPECT_EQ(
      deepest_gouge(r.paths, kStep, Frame::along(Vec3::UnitZ()), 1.5 + options.allowance_mm - 0.03),
      0);
  expect_orderly_rapids(r.paths);
  expect_no_plunge(r.paths, 0.6);
  // V_S is 10 x 20 x 12; a stepdown and the allowance may stay on the floor.
  EXPECT_LT(r.left_mm3, 10 * 20 * 1.3);
  EXPECT_GT(r.removed_mm3, 2400 * 0.87);
}

TEST(Roughing, RapidMayNotShaveTheSkinBesideAWallThatAFeedMoveMay) {
  const MillingOptions options = options_for_tests();
  const PartStock stock = part_stock(kBlock, kStep, 2e5);
  BlockStock block(stock, {kBlock, kStep, {}}, Frame::along(Vec3::UnitZ()), options.cutter);
  const Frame frame = Frame::along(Vec3::UnitZ());
  const auto tip = [&](double x, double y, double z) { return frame.to_local(Vec3(x, y, z)); };
  block.cut(tip(11.8, 5, 10), tip(11.8, 15, 10));
  const Vec3 nearer = tip(11.7, 10, 10.2);  // the wall of what is kept stands at x = 10
  EXPECT_LT(block.loose_depth(nearer), 0);
  EXPECT_GT(block.touch_depth(nearer), 5);
  EXPECT_LE(block.touch_depth(tip(11.7, 10, 20.5)), 0);
}

TEST(Roughing, StepIsClearedFromTheSideToo) {
  const Roughed r = roughed(kBlock, kStep, Vec3::UnitX(), options_for_tests());
  EXPECT_EQ(deepest_gouge(r.paths, kStep, Frame::along(Vec3::UnitX()), 1.5), 0);
  EXPECT_GT(r.removed_mm3, 2400 * 0.85);
}

TEST(Roughing, ClosedPocketIsEnteredByRamp) {
  // A pocket of 10 x 10 x 6 in the top.
  const TriangleMesh pocketed = joined(
      joined(make_box({0, 0, 0}, {20, 20, 14}), make_box({0, 0, 14}, {5, 20, 20})),
      joined(make_box({15, 0, 14}, {20, 20, 20}),
             joined(make_box({5, 0, 14}, {15, 5, 20}), make_box({5, 15, 14}, {15, 20, 20}))));
  const Roughed r = roughed(kBlock, pocketed, Vec3::UnitZ(), options_for_tests());
  EXPECT_EQ(deepest_gouge(r.paths, pocketed, Frame::along(Vec3::UnitZ()), 1.5), 0);
  expect_no_plunge(r.paths, 0.6);
  EXPECT_GT(r.removed_mm3, 600 * 0.6);
  int ramps = 0;
  for (const Path& path : r.paths) {
    for (const Move& move : path.moves) ramps += move.motion == Motion::kRamp;
  }
  EXPECT_GT(ramps, 20);
}

TEST(Roughing, NothingToRemoveGivesNoPath) {
  EXPECT_TRUE(roughed(kBlock, kBlock, Vec3::UnitZ(), options_for_tests()).paths.empty());
}

TEST(Roughing, HolderStaysAboveWhatStands) {
  // A shaft 15 mm deep beside a wall, and a holder that begins 10 mm above the tip: the lowest
  // 5 mm cannot be reached.
  MillingOptions options = options_for_tests();
  options.cutter.holder = {{10, 40, 12, 12}};
  const TriangleMesh wall =
      joined(make_box({0, 0, 0}, {10, 20, 20}), make_box({10, 0, 0}, {20, 20, 5}));
  const Roughed r = roughed(kBlock, wall, Vec3::UnitZ(), options);
  along(r.paths, [&](const Vec3& tip, Motion) {
    if (tip.x() < 21.9) {
      EXPECT_GE(tip.z(), 10 - 1e-6) << tip.transpose();
    }
  });
  EXPECT_GT(r.left_mm3, 10 * 20 * 4.5);
}

TEST(Roughing, TipStaysAboveTheBaseWhenItMust) {
  MillingOptions options = options_for_tests();
  options.tip_above_base = true;
  const TriangleMesh half = make_box({0, 0, 0}, {10, 20, 20});
  for (const Vec3& d : {Vec3(0, 0, 1), Vec3(1, 0, 0), Vec3(0.6, 0, 0.8)}) {
    const Frame frame = Frame::along(d);
    along(roughed(kBlock, half, d, options).paths, [&](const Vec3& tip, Motion motion) {
      if (motion != Motion::kRapid) {
        EXPECT_GE(frame.to_part(tip).z(), -0.01);
      }
    });
  }
}

}  // namespace
}  // namespace reforge

// Clean-up of a slot that the ball fits only without roughing's allowance.
#include "planner/toolpath/clean_up.h"

#include <gtest/gtest.h>

#include "planner/toolpath/roughing.h"
#include "tests/planner/milling_checks.h"

namespace reforge {
namespace {

using namespace milling_checks;

const TriangleMesh kBlock = make_box({0, 0, 0}, {20, 20, 20});

TEST(CleanUp, SlotThatRoughingsAllowanceClosesIsEntered) {
  // 3.4 mm wide, 12 mm long, 6 mm deep; the ball measures 3 mm.
  const TriangleMesh slotted = joined(
      joined(make_box({0, 0, 0}, {20, 20, 14}), make_box({0, 0, 14}, {8, 20, 20})),
      joined(make_box({11.4, 0, 14}, {20, 20, 20}),
             joined(make_box({8, 0, 14}, {11.4, 4, 20}), make_box({8, 16, 14}, {11.4, 20, 20}))));
  const MillingOptions options = options_for_tests();
  const Surroundings solids{kBlock, slotted, {}};
  const Frame frame = Frame::along(Vec3::UnitZ());
  PartStock stock = part_stock(kBlock, slotted, 2e5);
  BlockStock block(stock, solids, frame, options.cutter);
  const auto never = [] { return false; };
  std::vector<Path> paths = rough(options, solids, never, block);
  const auto left = [&] {
    PartStock after = stock;
    block.commit(after);
    BitSet rest = after.rest();
    return after.volume_mm3(rest.subtract(after.near_keep));
  };
  const double before = left();
  EXPECT_GT(before, 50);
  clean_up(options, solids, never, block, paths);
  EXPECT_LT(left(), 0.7 * before);
  EXPECT_EQ(deepest_gouge(paths, slotted, frame, 1.5), 0);
}

TEST(CleanUp, NothingLeftGivesNoPath) {
  const PartStock stock = part_stock(kBlock, kBlock, 2e5);
  const Surroundings solids{kBlock, kBlock, {}};
  const MillingOptions options = options_for_tests();
  BlockStock block(stock, solids, Frame::along(Vec3::UnitZ()), options.cutter);
  std::vector<Path> paths;
  clean_up(
      options, solids, [] { return false; }, block, paths);
  EXPECT_TRUE(paths.empty());
}

}  // namespace
}  // namespace reforge

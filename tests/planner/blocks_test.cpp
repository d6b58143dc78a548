// Blocks of shapes a reader can see.
#include <gtest/gtest.h>

#include "planner/blocks/additive_blocks.h"
#include "planner/blocks/milled_blocks.h"
#include "planner/blocks/print_outlook.h"
#include "planner/blocks/subtractive_blocks.h"
#include "planner/blocks/voxel_solid.h"
#include "tests/planner/milling_checks.h"

namespace reforge {
namespace {

using namespace milling_checks;

const TriangleMesh kNothing;
const Nozzle kNozzle{{{0.2, 5, 1, 1}, {5, 20, 4.5, 4.5}, {20, 110, 18, 18}}};

bool has(const std::vector<Vec3>& directions, const Vec3& d) {
  for (const Vec3& known : directions) {
    if (known.dot(d) > 0.999) return true;
  }
  return false;
}

struct Pair {
  TriangleMesh initial, reused, removed;
};

std::vector<Vec3> directions_for(const Pair& pair, const std::vector<Vec3>& further = {}) {
  const PartStock stock = part_stock(pair.initial, pair.reused, 1e5);
  const auto surface = machined_surface(pair.reused, pair.removed, 0.8);
  return milling_directions(options_for_tests(), {pair.initial, pair.reused, kNothing}, stock,
                            surface, further, [](const Vec3&) { return true; });
}

TEST(SubtractiveBlocks, AStepNeedsOneDirection) {
  const Pair step{make_box({0, 0, 0}, {20, 20, 20}),
                  joined(make_box({0, 0, 0}, {10, 20, 20}), make_box({10, 0, 0}, {20, 20, 8})),
                  make_box({10, 0, 8}, {20, 20, 20})};
  EXPECT_EQ(directions_for(step).size(), 1u);
}

TEST(SubtractiveBlocks, ARoofedNotchIsMilledFromItsOpenSide) {
  // A slot 8 mm high through the side at +x, a roof above it.
  const Pair notch{
      make_box({0, 0, 0}, {20, 20, 20}),
      joined(joined(make_box({0, 0, 0}, {20, 20, 6}), make_box({0, 0, 14}, {20, 20, 20})),
             make_box({0, 0, 6}, {8, 20, 14})),
      make_box({8, 0, 6}, {20, 20, 14})};
  const std::vector<Vec3> chosen = directions_for(notch);
  EXPECT_TRUE(has(chosen, Vec3(1, 0, 0)));
  EXPECT_FALSE(has(chosen, Vec3(0, 0, 1)));
}

TEST(SubtractiveBlocks, NothingToRemoveNeedsNoDirection) {
  const TriangleMesh box = make_box({0, 0, 0}, {10, 10, 10});
  EXPECT_TRUE(directions_for({box, box, kNothing}).empty());
}

TEST(MilledBlocks, RemoveDisjointVoxelsAndFinishWhatTheyTouch) {
  const Pair cross{make_box({0, 0, 0}, {18, 18, 18}), make_box({4, 4, 0}, {14, 14, 18}),
                   joined(make_box({0, 0, 0}, {4, 18, 18}), make_box({14, 0, 0}, {18, 18, 18}))};
  PartStock stock = part_stock(cross.initial, cross.reused, 1e5);
  const auto surface = machined_surface(cross.reused, cross.removed, 0.8);
  const auto before = stock.rest().count();
  const Milling milling = mill_blocks(
      options_for_tests(), {cross.initial, cross.reused, kNothing}, surface,
      {Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(0, 0, 1)}, [] { return false; },
      [](const std::string&) {}, stock);
  size_t removed = 0;
  for (const MilledBlock& block : milling.blocks) {
    removed += block.removed.count();
    EXPECT_FALSE(block.toolpath.paths.empty());
    EXPECT_EQ(deepest_gouge(block.toolpath.paths, cross.reused, block.toolpath.frame, 1.489), 0);
  }
  EXPECT_EQ(removed + stock.rest().count(), before);
  EXPECT_GT(milling.samples_finished, surface.size() * 9 / 10);
}

TEST(VoxelSolid, IsClosedAndHasTheVoxelsVolume) {
  const VoxelSet voxels = sample(make_box({0, 0, 0}, {4, 4, 4}),
                                 VoxelGrid::over(Box3(Vec3(0, 0, 0), Vec3(4, 4, 4)), 1));
  BitSet some(voxels.size());
  // Two voxels that touch along an edge only, and two that touch at a corner only.
  for (const auto& [i, j, k] : std::vector<std::array<int, 3>>{{0, 0, 0}, {1, 1, 0}, {2, 2, 1}}) {
    some.set(static_cast<size_t>(voxels.number(i + 1, j + 1, k + 1)));
  }
  const TriangleMesh solid = voxel_solid(voxels, some);
  EXPECT_NEAR(volume(solid), 3, 0.02);
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& t : solid.triangles) {
    for (int i = 0; i < 3; ++i)
      edges[std::minmax(t[i], t[(i + 1) % 3])] += t[i] < t[(i + 1) % 3] ? 1 : -1;
  }
  for (const auto& [edge, balance] : edges) EXPECT_EQ(balance, 0);
}

TEST(AdditiveBlocks, PartsApartAreBlocksApart) {
  const TriangleMesh base = make_box({0, 0, 0}, {30, 20, 10});
  const TriangleMesh added =
      joined(make_box({2, 2, 10}, {8, 8, 14}), make_box({20, 2, 10}, {28, 8, 16}));
  std::vector<PrintingBase> bases(2);
  for (PrintingBase& b : bases) {
    b.facets = {Plane::through({0, 0, 10}, Vec3::UnitZ())};
    b.print_direction = Vec3::UnitZ();
    b.area_mm2 = 10;
  }
  bases[0].point = {5, 5, 10};
  bases[1].point = {24, 5, 10};
  const TriangleMesh target = joined(base, added);
  const auto blocks =
      additive_blocks(added, bases, kNozzle, {target, {&base}, {Vec3::UnitZ()}, true});
  ASSERT_TRUE(blocks.ok());
  ASSERT_EQ(blocks->size(), 2u);
  EXPECT_NEAR(volume((*blocks)[0].solid) + volume((*blocks)[1].solid), volume(added), 1e-6);
}

TEST(AdditiveBlocks, ConnectedPartsKeepTheirCavities) {
  TriangleMesh hollow = make_box({0, 0, 0}, {10, 10, 10});
  TriangleMesh inner = make_box({3, 3, 3}, {7, 7, 7});
  for (auto& t : inner.triangles) std::swap(t[1], t[2]);
  const auto parts =
      connected_parts(joined(joined(hollow, inner), make_box({20, 0, 0}, {21, 1, 1})));
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_NEAR(volume(parts[0]), 1000 - 64, 1e-9);
}

TEST(PrintOutlook, AnArmOutwardsIsCutWhereItBends) {
  // A post with a long arm to +x at its top: upright the arm hangs, along +x it can be printed.
  const TriangleMesh base = make_box({0, 0, 0}, {6, 6, 10});
  const TriangleMesh post = make_box({0, 0, 10}, {6, 6, 20}),
                     arm = make_box({6, 0, 14}, {30, 6, 20});
  const TriangleMesh target = joined(joined(base, post), arm);
  PrintOutlook outlook(target, {&base}, kNozzle, {Vec3::UnitZ(), Vec3::UnitX()});
  std::vector<int> samples = outlook.samples_in(post);
  for (const int s : outlook.samples_in(arm)) samples.push_back(s);
  const PrintOutlook::Split split = outlook.best_split(samples, 0);
  ASSERT_GT(split.gain, 0);
  EXPECT_NEAR(split.plane.normal.x(), 1, 1e-9);
  EXPECT_NEAR(split.plane.offset, 6, 2.5);
}

}  // namespace
}  // namespace reforge

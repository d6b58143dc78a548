// Finishing of shapes whose surface is known: a flat, a hemisphere, tilted and plumb walls.
#include "planner/toolpath/finishing.h"

#include <gtest/gtest.h>

#include <numbers>

#include "planner/toolpath/roughing.h"
#include "tests/planner/milling_checks.h"

namespace reforge {
namespace {

using namespace milling_checks;

struct Finished {
  std::vector<Path> paths;
  std::vector<MachinedSample> samples;
  std::vector<char> done;
  double share_done(const std::vector<char>& of) const {
    int all = 0, passed = 0;
    for (size_t i = 0; i < samples.size(); ++i) {
      all += of[i];
      passed += of[i] && done[i];
    }
    return all ? static_cast<double>(passed) / all : 1;
  }
};

// Everything that the ball can touch from the direction, after roughing from there.
Finished finished(const TriangleMesh& initial, const TriangleMesh& reused,
                  const TriangleMesh& removed, const Vec3& direction,
                  std::vector<char>& touchables) {
  const MillingOptions options = options_for_tests();
  const TriangleMesh no_fixture;
  PartStock stock = part_stock(initial, reused, 2e5);
  const Surroundings solids{initial, reused, no_fixture};
  const Frame frame = Frame::along(direction);
  BlockStock block(stock, solids, frame, options.cutter);
  const auto go_on = [] { return false; };
  rough(options, solids, go_on, block);
  Finished result;
  result.samples = machined_surface(reused, removed, 0.5);
  result.done.assign(result.samples.size(), 0);
  const TipFloor floor(solids, frame, options, 0);
  const Clearance clearance(block.standing(), options.cutter);
  touchables.clear();
  for (const MachinedSample& s : result.samples) {
    touchables.push_back(touchable(s, frame, floor, clearance, options.cutter.ball_radius_mm));
  }
  finish(options, solids, result.samples, touchables, go_on, block, result.done, result.paths);
  return result;
}

// The largest height left over the surface among points the ball can touch: for each sample the
// nearest ball on a fine walk along the paths.
double highest_ridge(const Finished& f, const std::vector<char>& touchables, const Frame& frame,
                     double ball) {
  std::vector<double> gap(f.samples.size(), 1e9);
  const SampleIndex index(f.samples, 0.6);
  along(f.paths, [&](const Vec3& tip, Motion motion) {
    if (motion == Motion::kRapid) return;
    const Vec3 centre = frame.to_part(tip + Vec3(0, 0, ball));
    for (int k = 0; k < 64; ++k) {
      // Points of the lower half of the ball, near which samples may lie.
      const double lift = (k / 16) * 0.5, turn = 2 * std::numbers::pi * (k % 16) / 16;
      const Vec3 n = frame.to_part(
          Vec3(std::sin(lift) * std::cos(turn), std::sin(lift) * std::sin(turn), -std::cos(lift)));
      index.near(centre + ball * n, -n, [&](int i) {
        // How far above the sample, along its normal, the ball leaves material.
        const Vec3 d = f.samples[i].point - centre;
        const double along_normal = d.dot(f.samples[i].normal);
        const double aside2 = d.squaredNorm() - along_normal * along_normal;
        if (aside2 < ball * ball) {
          gap[i] = std::min(gap[i], -along_normal - std::sqrt(ball * ball - aside2));
        }
      });
    }
  });
  double worst = 0;
  for (size_t i = 0; i < gap.size(); ++i) {
    if (touchables[i]) worst = std::max(worst, gap[i]);
  }
  return worst;
}

const TriangleMesh kBlock = make_box({0, 0, 0}, {20, 20, 20});

TEST(MachinedSurface, IsOnlyWhereMaterialWasTaken) {
  const TriangleMesh lower = make_box({0, 0, 0}, {20, 20, 12});
  const auto samples = machined_surface(lower, make_box({0, 0, 12}, {20, 20, 20}), 0.5);
  ASSERT_GT(samples.size(), 1000u);
  for (const MachinedSample& s : samples) {
    EXPECT_NEAR(s.point.z(), 12, 1e-9);
    EXPECT_NEAR(s.normal.z(), 1, 1e-9);
  }
}

TEST(Finishing, FlatIsCoveredWithoutGouge) {
  const TriangleMesh lower = make_box({0, 0, 0}, {20, 20, 12});
  std::vector<char> touchables;
  const Finished f =
      finished(kBlock, lower, make_box({0, 0, 12}, {20, 20, 20}), Vec3::UnitZ(), touchables);
  EXPECT_EQ(f.share_done(touchables), 1);
  EXPECT_LE(deepest_gouge(f.paths, lower, Frame::along(Vec3::UnitZ()), 1.5), 0.004);
  EXPECT_LE(highest_ridge(f, touchables, Frame::along(Vec3::UnitZ()), 1.5), 0.03);
  expect_orderly_rapids(f.paths);
  expect_no_plunge(f.paths, 0.6);
}

TEST(Finishing, StepHasItsFloorAndItsPlumbWall) {
  const TriangleMesh step =
      joined(make_box({0, 0, 0}, {10, 20, 20}), make_box({10, 0, 0}, {20, 20, 8}));
  std::vector<char> touchables;
  const Finished f =
      finished(kBlock, step, make_box({10, 0, 8}, {20, 20, 20}), Vec3::UnitZ(), touchables);
  EXPECT_GT(f.share_done(touchables), 0.97);
  EXPECT_LE(deepest_gouge(f.paths, step, Frame::along(Vec3::UnitZ()), 1.49), 0.004);
}

// A dome of radius 8 on a plate, as facets of 3 degrees.
TriangleMesh dome() {
  TriangleMesh mesh;
  const int rings = 30, sides = 120;
  for (int i = 0; i < rings; ++i) {
    const double lift = std::numbers::pi / 2 * i / rings;
    for (int k = 0; k < sides; ++k) {
      const double turn = 2 * std::numbers::pi * k / sides;
      mesh.vertices.emplace_back(10 + 8 * std::cos(lift) * std::cos(turn),
                                 10 + 8 * std::cos(lift) * std::sin(turn), 4 + 8 * std::sin(lift));
    }
  }
  mesh.vertices.emplace_back(10, 10, 12);
  mesh.vertices.emplace_back(10, 10, 4);
  const auto at = [&](int i, int k) { return static_cast<std::uint32_t>(i * sides + k % sides); };
  const auto top = static_cast<std::uint32_t>(rings * sides), foot = top + 1;
  for (int k = 0; k < sides; ++k) {
    for (int i = 0; i + 1 < rings; ++i) {
      mesh.triangles.push_back({at(i, k), at(i, k + 1), at(i + 1, k + 1)});
      mesh.triangles.push_back({at(i, k), at(i + 1, k + 1), at(i + 1, k)});
    }
    mesh.triangles.push_back({at(rings - 1, k), at(rings - 1, k + 1), top});
    mesh.triangles.push_back({foot, at(0, k + 1), at(0, k)});
  }
  return joined(make_box({0, 0, 0}, {20, 20, 4}), mesh);
}

TEST(Finishing, HemisphereIsRoundWithinTheScallop) {
  const TriangleMesh part = dome();
  std::vector<char> touchables;
  const Finished f =
      finished(kBlock, part, make_box({0, 0, 4}, {20, 20, 20}), Vec3::UnitZ(), touchables);
  EXPECT_GT(f.share_done(touchables), 0.97);
  EXPECT_LE(deepest_gouge(f.paths, part, Frame::along(Vec3::UnitZ()), 1.49), 0.004);
  expect_no_plunge(f.paths, 0.6);
}

TEST(Finishing, SideDirectionFinishesAPlumbWall) {
  const TriangleMesh half = make_box({0, 0, 0}, {12, 20, 20});
  std::vector<char> touchables;
  const Finished f =
      finished(kBlock, half, make_box({12, 0, 0}, {20, 20, 20}), Vec3::UnitX(), touchables);
  EXPECT_GT(f.share_done(touchables), 0.99);
  EXPECT_LE(deepest_gouge(f.paths, half, Frame::along(Vec3::UnitX()), 1.5), 0.004);
}

}  // namespace
}  // namespace reforge

// Poses computed by hand from RIG.md's formulas, and properties over random rigs.
#include "planner/machine/kinematics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace reforge {
namespace {

constexpr double kPi = std::numbers::pi;

RigDescription rig_with(RotaryTable table) {
  RigDescription rig{};
  rig.tilt = {Radians::degrees(-110), Radians::degrees(110), 1, 1};
  rig.c = {Radians::degrees(-360), Radians::degrees(360), 1, 1};
  rig.kinematics = {table, 1, 1, {0, 0, 0}, {0, 0, -10}, {0, 0, 0}};
  return rig;
}

RotaryAngles degrees(double tilt, double c) {
  return {Radians::degrees(tilt), Radians::degrees(c)};
}

void expect_near(const Point<MachineFrame>& j, double x, double y, double z) {
  EXPECT_NEAR(j.x, x, 1e-12);
  EXPECT_NEAR(j.y, y, 1e-12);
  EXPECT_NEAR(j.z, z, 1e-12);
}

TEST(Kinematics, BothAxesAtZeroGiveThePartFrame) {
  for (const RotaryTable table : {RotaryTable::kBC, RotaryTable::kAC}) {
    expect_near(to_machine(rig_with(table).kinematics, degrees(0, 0), {12, -7, 30}), 12, -7, 30);
  }
}

TEST(Kinematics, HandPoseOfABcTable) {
  // B 90: p - D = (0, 0, 40) about the pivot at z = -10 turns by -90 about y to (-40, 0, 0); plus
  // D.
  expect_near(to_machine(rig_with(RotaryTable::kBC).kinematics, degrees(90, 0), {0, 0, 30}), -40, 0,
              -10);
  // C 90 first turns (5, 0, 30) by -90 about z to (0, -5, 30).
  expect_near(to_machine(rig_with(RotaryTable::kBC).kinematics, degrees(90, 90), {5, 0, 30}), -40,
              -5, -10);
}

TEST(Kinematics, HandPoseOfAnAcTable) {
  // A 90: (0, 0, 40) about x by -90 goes to (0, 40, 0).
  expect_near(to_machine(rig_with(RotaryTable::kAC).kinematics, degrees(90, 0), {0, 0, 30}), 0, 40,
              -10);
}

TEST(Kinematics, HandPoseWithPivotOffTheOriginAndReversedSigns) {
  Kinematics k{RotaryTable::kBC, -1, -1, {1, 2, 3}, {4, 0, -5}, {0, 0, 0}};
  // p - r = (9, 0, 0); C 90 reversed: Rz(+90) gives (0, 9, 0); minus D = (-4, 9, 5); B 90 reversed:
  // Ry(+90) gives (5, 9, 4); plus r + D = (5, 2, -2).
  expect_near(to_machine(k, degrees(90, 90), {10, 2, 3}), 10, 11, 2);
}

TEST(Kinematics, AxisFollowsThePublishedFormulas) {
  const double b = 0.7, c = -1.9;
  const Vec3 bc =
      tool_axis(rig_with(RotaryTable::kBC).kinematics, {Radians::of(b), Radians::of(c)});
  EXPECT_LT((bc - Vec3(std::sin(b) * std::cos(c), std::sin(b) * std::sin(c), std::cos(b))).norm(),
            1e-14);
  const Vec3 ac =
      tool_axis(rig_with(RotaryTable::kAC).kinematics, {Radians::of(b), Radians::of(c)});
  EXPECT_LT((ac - Vec3(std::sin(b) * std::sin(c), -std::sin(b) * std::cos(c), std::cos(b))).norm(),
            1e-14);
}

TEST(Kinematics, ForwardUndoesInverseOverRandomRigs) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> length(-100, 100), angle(-kPi, kPi);
  for (int i = 0; i < 2000; ++i) {
    const bool bc = random() % 2 == 0;
    const Kinematics k{bc ? RotaryTable::kBC : RotaryTable::kAC,
                       random() % 2 ? 1 : -1,
                       random() % 2 ? 1 : -1,
                       {length(random), length(random), length(random)},
                       {bc ? length(random) : 0, bc ? 0 : length(random), length(random)},
                       {0, 0, 0}};
    const RotaryAngles angles{Radians::of(angle(random)), Radians::of(angle(random))};
    const Point<PartFrame> p{length(random), length(random), length(random)};
    const Point<PartFrame> back = to_part(k, angles, to_machine(k, angles, p));
    EXPECT_LT(std::hypot(p.x - back.x, p.y - back.y, p.z - back.z), 1e-9);
  }
}

TEST(Kinematics, EverySolutionPointsTheToolAsAskedAndNearestComesFirst) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 500; ++i) {
    RigDescription rig = rig_with(random() % 2 ? RotaryTable::kBC : RotaryTable::kAC);
    rig.kinematics.sign_tilt = random() % 2 ? 1 : -1;
    rig.kinematics.sign_c = random() % 2 ? 1 : -1;
    const Vec3 axis = Vec3(normal(random), normal(random), std::abs(normal(random))).normalized();
    const RotaryAngles from = degrees(20, 100);
    const auto solutions = rotary_solutions(rig, axis, from);
    ASSERT_GE(solutions.size(), 2u);
    double before = 0;
    for (const RotaryAngles& s : solutions) {
      EXPECT_LT((tool_axis(rig.kinematics, s) - axis).norm(), 1e-9);
      const double travel =
          std::abs((s.tilt - from.tilt).value()) + std::abs((s.c - from.c).value());
      EXPECT_GE(travel, before - 1e-8);
      before = travel;
    }
  }
}

TEST(Kinematics, UprightToolKeepsC) {
  const auto solutions =
      rotary_solutions(rig_with(RotaryTable::kBC), Vec3::UnitZ(), degrees(30, 77));
  ASSERT_EQ(solutions.size(), 1u);
  EXPECT_NEAR(solutions[0].c.in_degrees(), 77, 1e-12);
  EXPECT_NEAR(solutions[0].tilt.in_degrees(), 0, 1e-12);
}

TEST(Kinematics, TiltBeyondItsTravelIsNoSolution) {
  RigDescription rig = rig_with(RotaryTable::kBC);
  rig.tilt = {Radians::degrees(-20), Radians::degrees(60), 1, 1};
  EXPECT_TRUE(rotary_solutions(rig, Vec3::UnitX(), degrees(0, 0)).empty());
  const Vec3 leaning(std::sin(0.9), 0,
                     std::cos(0.9));  // 52 degrees: only the positive side reaches
  for (const RotaryAngles& s : rotary_solutions(rig, leaning, degrees(0, 0)))
    EXPECT_GT(s.tilt.value(), 0);
}

TEST(Kinematics, SweptRadiusHoldsThePartInEveryPose) {
  const Kinematics k{RotaryTable::kBC, 1, 1, {3, -2, 0}, {5, 0, -10}, {0, 0, 0}};
  const std::vector<Vec3> corners{{20, 10, 40}, {-20, 10, 0}, {20, -30, 15}};
  const double radius = swept_radius(k, corners);
  const Point<MachineFrame> pivot = tilt_pivot(k);
  double reached = 0;
  for (int b = -110; b <= 110; b += 5) {
    for (int c = 0; c < 360; c += 5) {
      for (const Vec3& p : corners) {
        const Point<MachineFrame> j = to_machine(k, degrees(b, c), part_point(p));
        reached = std::max(reached, std::hypot(j.x - pivot.x, j.y - pivot.y, j.z - pivot.z));
      }
    }
  }
  EXPECT_LE(reached, radius + 1e-9);
  EXPECT_GT(reached, radius - 0.1);
}

}  // namespace
}  // namespace reforge

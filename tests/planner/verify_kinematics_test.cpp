// Poses computed by hand from RIG.md's figures, not from any code.
#include <gtest/gtest.h>

#include <numbers>

#include "planner/verify/forward_kinematics.h"

namespace reforge::verify {
namespace {

constexpr double kRight = std::numbers::pi / 2;

Kinematics table(RotaryTable kind, Vec3 r, Vec3 d, int sign_tilt = 1, int sign_c = 1) {
  return {kind, sign_tilt, sign_c, {r.x(), r.y(), r.z()}, {d.x(), d.y(), d.z()}, {0, 0, 0}};
}

void expect_near(const Vec3& a, const Vec3& b) {
  EXPECT_NEAR((a - b).norm(), 0, 1e-12) << a.transpose() << " against " << b.transpose();
}

TEST(VerifyKinematics, AtZeroThePartFrameIsTheMachineFrame) {
  for (const RotaryTable kind : {RotaryTable::kBC, RotaryTable::kAC}) {
    const Pose pose = pose_at(table(kind, {3, 4, 5}, {1, 2, -10}), 0, 0);
    expect_near(pose.to_part({7, -8, 9}), {7, -8, 9});
    expect_near(pose.tool_axis(), {0, 0, 1});
  }
}

// BC, r = 0, D = (0, 0, -10), B = 90: the tool comes along +X. The machine point (0, 0, 0) lies 10
// above the tilt axis, so it meets the part 10 beside it: at (10, 0, -10).
TEST(VerifyKinematics, BcTiltedBy90MeetsThePartFromPlusX) {
  const Pose pose = pose_at(table(RotaryTable::kBC, {0, 0, 0}, {0, 0, -10}), kRight, 0);
  expect_near(pose.tool_axis(), {1, 0, 0});
  expect_near(pose.to_part({0, 0, 0}), {10, 0, -10});
  // 5 to the machine's right is 5 down the part.
  expect_near(pose.to_part({5, 0, 0}), {10, 0, -15});
  expect_near(pose.to_part({0, 3, 20}), {30, 3, -10});
}

TEST(VerifyKinematics, BcThenCBy90MeetsThePartFromPlusY) {
  const Pose pose = pose_at(table(RotaryTable::kBC, {0, 0, 0}, {0, 0, -10}), kRight, kRight);
  expect_near(pose.tool_axis(), {0, 1, 0});
  expect_near(pose.to_part({0, 0, 0}), {0, 10, -10});
}

// The C axis stands at (2, 1, 0), the tilt axis 4 beside and 10 below it.
TEST(VerifyKinematics, PivotsOffTheOriginShiftThePart) {
  const Kinematics k = table(RotaryTable::kBC, {2, 1, 0}, {4, 0, -10});
  // j - r - D = (-6, -1, 10); Ry(90): (10, -1, 6); + D: (14, -1, -4); + r: (16, 0, -4).
  expect_near(pose_at(k, kRight, 0).to_part({0, 0, 0}), {16, 0, -4});
  // Rz(90) of (14, -1, -4): (1, 14, -4); + r: (3, 15, -4).
  expect_near(pose_at(k, kRight, kRight).to_part({0, 0, 0}), {3, 15, -4});
}

// AC: A = 90 turns the tool to come along -Y; C then turns it about Z.
TEST(VerifyKinematics, AcTiltedBy90MeetsThePartFromMinusY) {
  const Kinematics k = table(RotaryTable::kAC, {0, 0, 0}, {0, 0, -10});
  const Pose pose = pose_at(k, kRight, 0);
  expect_near(pose.tool_axis(), {0, -1, 0});
  expect_near(pose.to_part({0, 0, 0}), {0, -10, -10});
  expect_near(pose_at(k, kRight, kRight).tool_axis(), {1, 0, 0});
}

TEST(VerifyKinematics, EachSignTurnsItsOwnAxis) {
  const Vec3 d(0, 0, -10);
  expect_near(pose_at(table(RotaryTable::kBC, {0, 0, 0}, d, -1, 1), kRight, 0).tool_axis(),
              {-1, 0, 0});
  expect_near(pose_at(table(RotaryTable::kBC, {0, 0, 0}, d, 1, -1), kRight, kRight).tool_axis(),
              {0, -1, 0});
}

TEST(VerifyKinematics, MachineAndPartRoundTrip) {
  const Pose pose = pose_at(table(RotaryTable::kAC, {3, -2, 1}, {0, 5, -40}, -1, 1), 0.7, -2.1);
  expect_near(pose.to_machine(pose.to_part({11, -12, 13})), {11, -12, 13});
}

}  // namespace
}  // namespace reforge::verify

// Times computed by hand from the trapezoid.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "planner/verify/time_model.h"

namespace reforge::verify {
namespace {

RigDescription rig() {
  RigDescription r{};
  r.x = r.y = r.z = {-100, 100, 50, 25, 200};
  r.tilt = r.c = {Radians::degrees(-90), Radians::degrees(90), 1.0, 2.0};
  return r;
}

// 10 mm at 10 mm/s, 200 mm/s2: 0.05 s up over 0.25 mm, 0.05 s down, 9.5 mm at 10 mm/s.
TEST(VerifyTime, OneMoveIsATrapezoid) {
  const RigDescription r = rig();
  TimeModel time(r);
  time.move({10, 0, 0}, 10.0);
  EXPECT_NEAR(time.seconds(), 0.05 + 0.05 + 0.95, 1e-9);
}

// 1 mm at up to 50 mm/s never gets there: 2 sqrt(1 / 200).
TEST(VerifyTime, AShortRapidIsATriangle) {
  const RigDescription r = rig();
  TimeModel time(r);
  time.move({0, 0, 1}, std::nullopt);
  EXPECT_NEAR(time.seconds(), 2 * std::sqrt(1.0 / 200), 1e-9);
}

TEST(VerifyTime, StraightOnIsNotSlowedByItsPieces) {
  const RigDescription r = rig();
  TimeModel whole(r), pieces(r);
  whole.move({10, 0, 0}, 10.0);
  for (int k = 0; k < 100; ++k) pieces.move({0.1, 0, 0}, 10.0);
  EXPECT_NEAR(pieces.seconds(), whole.seconds(), 1e-9);
}

TEST(VerifyTime, TurningBackComesToRest) {
  const RigDescription r = rig();
  TimeModel there(r), both(r);
  there.move({10, 0, 0}, 10.0);
  both.move({10, 0, 0}, 10.0);
  both.move({-10, 0, 0}, 10.0);
  EXPECT_NEAR(both.seconds(), 2 * there.seconds(), 1e-9);
}

// At 45 degrees each axis gives its 200 mm/s2: 283 along the way.
TEST(VerifyTime, AxesShareADiagonal) {
  const RigDescription r = rig();
  TimeModel time(r);
  time.move({1, 1, 0}, std::nullopt);
  EXPECT_NEAR(time.seconds(), 2 * std::sqrt(1.0 / 200), 1e-9);
}

// 90 degrees at 1 rad/s and 2 rad/s2: 1.5708 + 0.5.
TEST(VerifyTime, RotaryMovesAndDwellsAddUp) {
  const RigDescription r = rig();
  TimeModel time(r);
  time.turn(std::numbers::pi / 2, 0.1);
  time.dwell(2);
  EXPECT_NEAR(time.seconds(), std::numbers::pi / 2 + 0.5 + 2, 1e-9);
}

}  // namespace
}  // namespace reforge::verify

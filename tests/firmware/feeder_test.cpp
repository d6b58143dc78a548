// The filament motor's arithmetic, its timer run tick by tick.

#include "firmware/arduino-extruder/feeder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <random>

#include "firmware/arduino-extruder/limits.h"
#include "tests/firmware/desk.h"

namespace reforge::firmware {
namespace {

constexpr uint32_t kMsTicks = kTimerHz / 1000;

struct Motor {
  Feeder feeder;
  StepTimer timer{feeder};

  void run_ms(int ms) {
    for (int i = 0; i < ms; ++i) {
      feeder.tick();
      timer.run(kMsTicks);
    }
  }
  int run_to_rest() {
    int ms = 0;
    while (feeder.moving() && ms < 1'000'000) run_ms(1), ++ms;
    return ms;
  }
};

TEST(Feeder, StepsAtOnceAndThenAtItsRate) {
  Motor motor;
  motor.feeder.set_acceleration(84000);
  motor.feeder.run(150 * 256);
  motor.run_ms(10000);
  EXPECT_LT(motor.timer.steps().front(), kMsTicks);
  EXPECT_NEAR(static_cast<double>(motor.timer.steps().size()), 1500, 1);
  EXPECT_EQ(motor.feeder.position(), motor.timer.position());
}

TEST(Feeder, MeanRateIsExactOverAnHour) {
  Motor motor;
  motor.feeder.set_acceleration(84000);
  const uint32_t rate_q8 = 37317;  // 145.77 steps/s
  motor.feeder.run(rate_q8);
  motor.run_ms(3'600'000);
  EXPECT_NEAR(static_cast<double>(motor.feeder.position()), rate_q8 / 256.0 * 3600, 2);
}

TEST(Feeder, KeepsSlowerRatesThanOneWaitOfTheTimer) {
  Motor motor;
  motor.feeder.run(256);  // one step a second, waits of 2,000,000 ticks in a 16-bit timer
  motor.run_ms(10'500);
  EXPECT_EQ(motor.feeder.position(), 11);
}

TEST(Feeder, CountedMovesEndByTheirCount) {
  for (const int32_t steps : {1, -1, 2, 7, -420, 4200, -20000}) {
    for (const uint32_t rate : {50u, 200u, 1000u, 10500u, 20000u}) {
      Motor motor;
      motor.feeder.set_acceleration(84000);
      motor.feeder.move(steps, rate * 256);
      motor.run_to_rest();
      EXPECT_EQ(motor.feeder.position(), steps) << rate;
      EXPECT_EQ(motor.timer.position(), steps) << rate;
    }
  }
}

TEST(Feeder, ATrapezoidTakesItsTime) {
  Motor motor;
  motor.feeder.set_acceleration(20000);
  motor.feeder.move(4000, 5000 * 256);
  // Up and down in 0.24 s each from 200 steps/s (624 steps each), the rest at full rate.
  const double expected_s = 2 * 4800.0 / 20000 + (4000 - 2 * 624) / 5000.0;
  EXPECT_NEAR(motor.run_to_rest() / 1000.0, expected_s, 0.06);
}

TEST(Feeder, NeverLeapsBeyondItsAcceleration) {
  Motor motor;
  motor.feeder.set_acceleration(84000);
  motor.feeder.move(10000, 20000 * 256);
  motor.run_to_rest();
  const auto& steps = motor.timer.steps();
  double before = kStepRateStart;
  for (size_t i = 1; i < steps.size(); ++i) {
    const double seconds = static_cast<double>(steps[i] - steps[i - 1]) / kTimerHz;
    const double rate = 1 / seconds;
    // A staircase of a millisecond; and two ticks of rounding, each rate^2 / kTimerHz.
    EXPECT_LT(std::abs(rate - before), 84000 * (seconds + 0.002) + 2 * rate * rate / kTimerHz) << i;
    before = rate;
  }
}

TEST(Feeder, AZeroMoveIsNone) {
  Motor motor;
  motor.feeder.move(0, 256);
  EXPECT_FALSE(motor.feeder.moving());
  EXPECT_FALSE(motor.feeder.take_start());
}

TEST(Feeder, HaltIsAtOnceAndStopRampsDown) {
  Motor motor;
  motor.feeder.set_acceleration(20000);
  motor.feeder.run(10000 * 256);
  motor.run_ms(1000);
  motor.feeder.stop();
  const int ramp_ms = motor.run_to_rest();
  EXPECT_NEAR(ramp_ms, 9800 / 20, 10);

  motor.feeder.run(10000 * 256);
  motor.run_ms(1000);
  const int64_t position = motor.timer.position();
  motor.feeder.halt();
  EXPECT_FALSE(motor.feeder.moving());
  motor.run_ms(1000);
  EXPECT_EQ(motor.timer.position(), position);
  EXPECT_EQ(motor.feeder.position(), position);
}

TEST(Feeder, CountsAreExactOverRandomCommands) {
  std::mt19937 engine(20);
  const auto random = [&engine] { return static_cast<uint32_t>(engine()); };
  Motor motor;
  int64_t expected = 0;
  for (int round = 0; round < 20000; ++round) {
    motor.feeder.set_acceleration(1000 + random() % 1'000'000);
    const uint32_t rate_q8 = 256 * (20 + random() % 19980) + random() % 256;
    const int kind = static_cast<int>(random() % 4);
    if (kind == 0) {
      motor.feeder.run(rate_q8);
      motor.run_ms(static_cast<int>(random() % 40));
      motor.feeder.stop();
      motor.run_to_rest();
      expected = motor.timer.position();
    } else {
      const int32_t steps = static_cast<int32_t>(random() % 300) - 150;
      motor.feeder.move(steps, rate_q8);
      if (kind == 1) {
        motor.run_ms(static_cast<int>(random() % 20));
        if (random() % 2) {
          motor.feeder.halt();
        } else {
          motor.feeder.stop();
          motor.run_to_rest();
        }
        ASSERT_LE(std::abs(motor.timer.position() - expected), std::abs(steps));
        expected = motor.timer.position();
      } else {
        motor.run_to_rest();
        expected += steps;
      }
    }
    ASSERT_EQ(motor.timer.position(), expected) << round;
    ASSERT_EQ(motor.feeder.position(), expected) << round;
  }
}

}  // namespace
}  // namespace reforge::firmware

// The M70-M75 state machine: every state against every code, orders to their ends, dead-man,
// faults.

#include "firmware/arduino-extruder/extruder.h"

#include <gtest/gtest.h>

#include <random>
#include <string>

#include "protocols/extruder_text.h"
#include "tests/firmware/desk.h"

namespace reforge::firmware {
namespace {

using wire::Fault;
using wire::Reason;
using wire::Setting;
using wire::State;

Reason finished(Desk& desk) {
  Reason reason = Reason::kPending;
  desk.extruder.take_finished(reason);
  return reason;
}

Reason command(Desk& desk, uint8_t m_code, int32_t argument = wire::kUseSetting) {
  return desk.extruder.command(m_code, argument, desk.now_ms);
}

// Brings a desk into a state by orders alone.
void bring_to(Desk& desk, State state) {
  if (state == State::kClosed) {
    desk.run_ms(200);
    return;
  }
  if (state == State::kOpening) {
    desk.hot_end.set_temperature(150);
    desk.run_ms(200);
    command(desk, 70);
    desk.run_ms(2);
    return;
  }
  desk.open_hot();
  switch (state) {
    case State::kExtruding:
      command(desk, 72, 5000);
      break;
    case State::kStopping:
      desk.settings.set(Setting::kAcceleration, 1000);
      command(desk, 72, 5000);
      desk.run_ms(1000);
      command(desk, 73);
      break;
    case State::kRetracting:
      command(desk, 74, 5000);
      break;
    case State::kRetracted:
      command(desk, 74, 1000);
      desk.run_ms(2000);
      break;
    case State::kRestoring:
      command(desk, 74, 5000);
      desk.run_ms(2000);
      command(desk, 75);
      command(desk, 72, 5000);
      break;
    case State::kClosing:
      command(desk, 71);
      break;
    case State::kFault:
      desk.extruder.fault(Fault::kInternal);
      break;
    case State::kStandby:
      desk.extruder.fault(Fault::kInternal);
      desk.extruder.clear_fault(desk.now_ms);
      break;
    default:
      break;
  }
  desk.run_ms(2);
  finished(desk);
}

constexpr State kAll[] = {State::kClosed,     State::kOpening,   State::kReady,
                          State::kRestoring,  State::kExtruding, State::kStopping,
                          State::kRetracting, State::kClosing,   State::kStandby,
                          State::kFault,      State::kRetracted};

TEST(Extruder, EveryStateAnswersEveryCodeAsDocumented) {
  constexpr Reason kOk = Reason::kNone, kShut = Reason::kNotOpen, kBusy = Reason::kBusy,
                   kExtr = Reason::kExtrusionOn, kRetr = Reason::kRetractionOn,
                   kFlt = Reason::kFaultLatched;
  const Reason expected[wire::kStateCount][6] = {
      {kOk, kOk, kShut, kOk, kShut, kOk},      // closed
      {kBusy, kOk, kShut, kOk, kShut, kShut},  // opening
      {kOk, kOk, kOk, kOk, kOk, kOk},          // ready
      {kExtr, kOk, kExtr, kOk, kExtr, kExtr},  // restoring
      {kExtr, kOk, kExtr, kOk, kExtr, kOk},    // extruding
      {kBusy, kOk, kBusy, kOk, kBusy, kBusy},  // stopping
      {kRetr, kOk, kRetr, kOk, kBusy, kOk},    // retracting
      {kBusy, kOk, kShut, kOk, kShut, kShut},  // closing
      {kOk, kOk, kShut, kOk, kShut, kOk},      // standby
      {kFlt, kFlt, kFlt, kFlt, kFlt, kFlt},    // fault
      {kRetr, kOk, kRetr, kOk, kOk, kOk},      // retracted
  };
  for (const State state : kAll) {
    for (uint8_t m_code = 70; m_code <= 75; ++m_code) {
      Desk desk;
      bring_to(desk, state);
      const std::string where = std::string(name_of(state)) + " M" + std::to_string(m_code);
      ASSERT_EQ(desk.extruder.state(), state) << where;
      const int64_t position = desk.extruder.position();
      const Reason reason = expected[static_cast<size_t>(state)][m_code - 70];
      EXPECT_EQ(command(desk, m_code), reason) << where;
      if (reason != Reason::kNone) {
        EXPECT_EQ(desk.extruder.state(), state) << where;
        EXPECT_EQ(desk.extruder.position(), position) << where;
      }
    }
  }
}

TEST(Extruder, CodesOfOthersAreUnknown) {
  Desk desk;
  EXPECT_EQ(command(desk, 69), Reason::kUnknownCommand);
  EXPECT_EQ(command(desk, 76), Reason::kUnknownCommand);
}

TEST(Extruder, EveryAcceptedOrderComesToItsEndOnce) {
  for (const State state : kAll) {
    for (uint8_t m_code = 70; m_code <= 75; ++m_code) {
      Desk desk;
      bring_to(desk, state);
      desk.hot_end.set_temperature(205);
      if (command(desk, m_code) != Reason::kNone) continue;
      int ends = 0;
      for (int ms = 0; ms < 10'000; ++ms) {
        Reason reason;
        if (desk.extruder.take_finished(reason)) {
          ++ends;
          EXPECT_EQ(reason, Reason::kNone);
        }
        desk.run_ms(1);
      }
      EXPECT_EQ(ends, 1) << name_of(state) << " M" << int{m_code};
      EXPECT_FALSE(desk.extruder.under_way());
    }
  }
}

TEST(Extruder, ACycleEndsWhereItShould) {
  Desk desk;
  desk.open_hot();
  EXPECT_EQ(desk.extruder.state(), State::kReady);
  EXPECT_EQ(desk.extruder.module(), Module::kOpen);
  EXPECT_EQ(command(desk, 72, 1000), Reason::kNone);
  EXPECT_EQ(finished(desk), Reason::kNone);  // nothing to restore
  EXPECT_EQ(desk.extruder.speed(), 1000);
  desk.run_ms(1000);
  command(desk, 73);
  EXPECT_EQ(finished(desk), Reason::kPending);
  desk.run_ms(50);
  EXPECT_EQ(finished(desk), Reason::kNone);
  EXPECT_NEAR(desk.extruder.position(), 420, 5);
  const int32_t front = desk.extruder.position();

  command(desk, 74, 1000);
  desk.run_ms(500);
  EXPECT_EQ(finished(desk), Reason::kNone);
  EXPECT_EQ(desk.extruder.state(), State::kRetracted);
  EXPECT_EQ(desk.extruder.position(), front - 420);
  EXPECT_EQ(desk.extruder.retracted(), 420);
  command(desk, 75);
  EXPECT_EQ(finished(desk), Reason::kNone);
  EXPECT_EQ(desk.extruder.retracted(), 420);

  command(desk, 72, 1000);
  EXPECT_EQ(desk.extruder.state(), State::kRestoring);
  EXPECT_EQ(finished(desk), Reason::kPending);
  while (desk.extruder.state() == State::kRestoring) desk.run_ms(1);
  EXPECT_EQ(finished(desk), Reason::kNone);
  EXPECT_NEAR(desk.extruder.position(), front, 2);  // a first step may be out
  EXPECT_EQ(desk.extruder.state(), State::kExtruding);

  command(desk, 71);
  EXPECT_FALSE(desk.heater.heating());
  desk.run_ms(100);
  EXPECT_EQ(desk.extruder.module(), Module::kClosed);
  desk.run_ms(2000);
  EXPECT_EQ(finished(desk), Reason::kNone);
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
  EXPECT_EQ(desk.extruder.position(), desk.timer.position());
}

TEST(Extruder, ColdFilamentIsNotMoved) {
  Desk desk;
  desk.open_hot();
  desk.hot_end.set_temperature(165);
  desk.run_ms(200);
  EXPECT_EQ(command(desk, 72), Reason::kTooCold);
  EXPECT_EQ(command(desk, 74), Reason::kTooCold);
  EXPECT_EQ(desk.extruder.state(), State::kReady);
}

TEST(Extruder, FilamentThatColdsWhileMovingIsAFault) {
  Desk desk;
  desk.open_hot();
  command(desk, 72);
  desk.run_ms(1000);
  desk.hot_end.set_temperature(160);
  desk.run_ms(200);
  EXPECT_EQ(desk.extruder.fault(), Fault::kRunaway);
  EXPECT_FALSE(desk.feeder.moving());
}

TEST(Extruder, ArgumentsOutsideTheLimitsAreRefused) {
  Desk desk;
  desk.run_ms(200);
  EXPECT_EQ(command(desk, 70, 1699), Reason::kBadArgument);
  EXPECT_EQ(command(desk, 70, 2601), Reason::kBadArgument);
  EXPECT_EQ(command(desk, 70, -1), Reason::kBadArgument);
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
  desk.open_hot();
  EXPECT_EQ(command(desk, 72, -1), Reason::kBadArgument);
  EXPECT_EQ(command(desk, 72, 1), Reason::kBadArgument);       // less than a step a second
  EXPECT_EQ(command(desk, 72, 60'000), Reason::kBadArgument);  // beyond the step rate
  EXPECT_EQ(command(desk, 72, 2'000'000'000), Reason::kBadArgument);
  EXPECT_EQ(command(desk, 74, -1), Reason::kBadArgument);
  EXPECT_EQ(command(desk, 74, 20'001), Reason::kBadArgument);
  EXPECT_EQ(desk.extruder.extrude_length(0, 1000), Reason::kBadArgument);
  EXPECT_EQ(desk.extruder.extrude_length(200'001, 1000), Reason::kBadArgument);
}

TEST(Extruder, ALengthEndsByItself) {
  Desk desk;
  desk.open_hot();
  EXPECT_EQ(desk.extruder.extrude_length(2000, 5000), Reason::kNone);
  EXPECT_EQ(finished(desk), Reason::kPending);
  desk.run_ms(1000);
  EXPECT_EQ(finished(desk), Reason::kNone);
  EXPECT_EQ(desk.extruder.position(), 840);
  EXPECT_EQ(desk.extruder.state(), State::kReady);
  command(desk, 71);
  desk.run_ms(2000);
  EXPECT_EQ(desk.extruder.extrude_length(2000, 5000), Reason::kNotOpen);
}

TEST(Extruder, RetractionIsNeverDoubled) {
  Desk desk;
  desk.open_hot();
  command(desk, 74, 2000);
  desk.run_ms(20);
  command(desk, 75);  // ended half-way
  desk.run_ms(100);
  EXPECT_EQ(desk.extruder.state(), State::kReady);
  const int32_t part = desk.extruder.retracted();
  EXPECT_GT(part, 0);
  EXPECT_LT(part, 840);
  command(desk, 74, 2000);  // only the rest
  desk.run_ms(1000);
  EXPECT_EQ(desk.extruder.retracted(), 840);
  EXPECT_EQ(command(desk, 74, 1000), Reason::kNone);  // less than there is: nothing to do
  EXPECT_EQ(desk.extruder.retracted(), 840);
}

TEST(Extruder, AnInterruptedRestorationIsRemembered) {
  Desk desk;
  bring_to(desk, State::kRestoring);
  command(desk, 73);
  desk.run_ms(200);
  EXPECT_EQ(desk.extruder.state(), State::kReady);
  const int32_t left = desk.extruder.retracted();
  EXPECT_GT(left, 0);
  command(desk, 72, 1000);
  desk.run_ms(3000);
  EXPECT_EQ(desk.extruder.retracted(), 0);
  EXPECT_EQ(desk.extruder.state(), State::kExtruding);
}

TEST(Extruder, StoppingWhileHeatingLeavesItOpenAndCold) {
  Desk desk;
  bring_to(desk, State::kOpening);
  EXPECT_EQ(command(desk, 73), Reason::kNone);
  EXPECT_EQ(desk.extruder.state(), State::kStandby);
  EXPECT_FALSE(desk.heater.heating());
  EXPECT_EQ(command(desk, 70), Reason::kNone);
}

TEST(Extruder, HeatingTooLongIsAFault) {
  Desk desk;
  desk.settings.set(Setting::kHeatUpTime, 10'000);
  desk.settings.set(Setting::kRiseTime, 60'000);
  bring_to(desk, State::kOpening);
  desk.run_ms(12'000);
  EXPECT_EQ(desk.extruder.fault(), Fault::kHeaterTimeout);
  EXPECT_EQ(finished(desk), Reason::kFaulted);
}

TEST(Extruder, WithoutAHeaterItOpensByTimeAndTemperatureIsUnknown) {
  Desk desk;
  desk.settings.set(Setting::kHeaterFitted, 0);
  desk.run_ms(100);
  EXPECT_EQ(command(desk, 70), Reason::kNone);
  desk.run_ms(1000);
  EXPECT_EQ(desk.extruder.state(), State::kOpening);
  desk.run_ms(1000);
  EXPECT_EQ(desk.extruder.state(), State::kReady);
  EXPECT_EQ(desk.extruder.temperature(), wire::kTemperatureUnknown);
  EXPECT_FALSE(desk.heater.heating());
  EXPECT_EQ(command(desk, 72), Reason::kNone);
}

TEST(Extruder, SilenceWhileExtrudingStopsWithinHalfASecond) {
  Desk desk;
  bring_to(desk, State::kExtruding);
  desk.run_ms(1000);
  desk.silent = true;
  int ms = 0;
  while (desk.feeder.moving()) desk.run_ms(1), ++ms;
  EXPECT_LE(ms, 502);
  EXPECT_EQ(desk.extruder.fault(), Fault::kExtrusionSilence);
  EXPECT_FALSE(desk.heater.heating());
  EXPECT_FALSE(desk.extruder.run_permitted());
  wire::FaultReport report = {};
  ASSERT_TRUE(desk.extruder.take_fault_report(report));
  EXPECT_EQ(report.fault, Fault::kExtrusionSilence);
  EXPECT_EQ(report.state_before, State::kExtruding);
  EXPECT_FALSE(desk.extruder.take_fault_report(report));
}

TEST(Extruder, SilenceWhileOpenEndsHeatAfterThreeSeconds) {
  for (const State state : {State::kOpening, State::kReady, State::kRetracted}) {
    Desk desk;
    bring_to(desk, state);
    desk.run_ms(100);
    desk.silent = true;
    desk.run_ms(2800);
    EXPECT_EQ(desk.extruder.state(), state) << name_of(state);
    desk.run_ms(300);
    EXPECT_EQ(desk.extruder.fault(), Fault::kSilence);
    EXPECT_FALSE(desk.heater.heating());
  }
}

TEST(Extruder, SilenceWhileClosedOnlyTakesTheRunPermission) {
  Desk desk;
  EXPECT_FALSE(desk.extruder.run_permitted());
  desk.run_ms(200);
  EXPECT_TRUE(desk.extruder.run_permitted());
  desk.silent = true;
  desk.run_ms(3200);
  EXPECT_FALSE(desk.extruder.run_permitted());
  EXPECT_EQ(desk.extruder.fault(), Fault::kNone);
  desk.silent = false;
  desk.run_ms(200);
  EXPECT_TRUE(desk.extruder.run_permitted());
}

TEST(Extruder, RunningOutOfFilamentStops) {
  Desk desk;
  bring_to(desk, State::kExtruding);
  desk.filament = false;
  desk.run_ms(100);
  EXPECT_EQ(desk.extruder.state(), State::kExtruding);  // no sensor is fitted
  EXPECT_TRUE(desk.extruder.filament_present());

  Desk fitted;
  fitted.settings.set(Setting::kFilamentSensor, 1);
  bring_to(fitted, State::kExtruding);
  fitted.filament = false;
  fitted.run_ms(100);
  EXPECT_EQ(fitted.extruder.fault(), Fault::kFilamentOut);
  fitted.extruder.clear_fault(fitted.now_ms);
  fitted.open_hot();
  EXPECT_EQ(command(fitted, 72), Reason::kNoFilament);
}

TEST(Extruder, AFaultStopsEverythingAndStaysUntilCleared) {
  Desk desk;
  bring_to(desk, State::kExtruding);
  desk.hot_end.set_sensor(SensorWiring::kOpen);
  desk.run_ms(500);
  EXPECT_EQ(desk.extruder.fault(), Fault::kSensorOpen);
  EXPECT_FALSE(desk.feeder.moving());
  EXPECT_FALSE(desk.heater.heating());
  EXPECT_FALSE(desk.heater_on);
  EXPECT_FALSE(desk.extruder.run_permitted());
  EXPECT_EQ(desk.extruder.module(), Module::kOpen);
  desk.extruder.fault(Fault::kInternal);  // the first one stands
  EXPECT_EQ(desk.extruder.fault(), Fault::kSensorOpen);
  EXPECT_EQ(desk.extruder.clear_fault(desk.now_ms), Reason::kFaultPersists);
  desk.hot_end.set_sensor(SensorWiring::kConnected);
  desk.run_ms(200);
  EXPECT_EQ(desk.extruder.clear_fault(desk.now_ms), Reason::kNone);
  EXPECT_EQ(desk.extruder.state(), State::kStandby);
  desk.open_hot();
  EXPECT_EQ(desk.extruder.state(), State::kReady);
}

TEST(Extruder, AFaultWhileClosedClearsToClosed) {
  Desk desk;
  desk.hot_end.set_temperature(290);
  desk.run_ms(200);
  EXPECT_EQ(desk.extruder.fault(), Fault::kOverTemperature);
  EXPECT_EQ(desk.extruder.clear_fault(desk.now_ms), Reason::kFaultPersists);
  desk.hot_end.set_temperature(25);
  desk.run_ms(200);
  EXPECT_EQ(desk.extruder.clear_fault(desk.now_ms), Reason::kNone);
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
  EXPECT_EQ(desk.extruder.clear_fault(desk.now_ms), Reason::kNone);  // nothing to clear
}

TEST(Extruder, ALengthOfNoStepIsRefused) {
  Desk desk;
  desk.settings.set(Setting::kStepsPerMetre, 1000);
  desk.open_hot();
  EXPECT_EQ(desk.extruder.extrude_length(100, 5000), Reason::kBadArgument);
}

TEST(Extruder, RetractionKeepsToTheMotorsRates) {
  Desk fast;  // 100 mm/s at 420 steps/mm would be 42,000 steps/s
  fast.settings.set(Setting::kRetractSpeed, 100'000);
  fast.settings.set(Setting::kAcceleration, 2'000'000);
  fast.open_hot();
  command(fast, 74, 20'000);
  fast.run_ms(3000);
  EXPECT_EQ(fast.extruder.retracted(), 8400);
  const auto& steps = fast.timer.steps();
  for (size_t i = 1; i < steps.size(); ++i) ASSERT_GE(steps[i] - steps[i - 1], 99u);

  Desk slow;  // 0.1 mm/s at 1 step/mm would be a step in ten seconds
  slow.settings.set(Setting::kRetractSpeed, 100);
  slow.settings.set(Setting::kStepsPerMetre, 1000);
  slow.open_hot();
  command(slow, 74, 3000);
  slow.run_ms(4000);
  EXPECT_EQ(slow.extruder.retracted(), 3);
}

TEST(Extruder, ATerminalDoesNotProlongAHostsExtrusion) {
  Desk desk;
  bring_to(desk, State::kExtruding);
  desk.silent = true;
  desk.extruder.refresh(Authority::kTerminal, desk.now_ms);
  desk.run_ms(600);
  EXPECT_EQ(desk.extruder.fault(), Fault::kExtrusionSilence);
}

TEST(Extruder, RetractingNeedsNoFilamentAhead) {
  Desk desk;
  desk.settings.set(Setting::kFilamentSensor, 1);
  bring_to(desk, State::kRetracting);
  desk.filament = false;
  desk.run_ms(1000);
  EXPECT_EQ(desk.extruder.state(), State::kRetracted);
}

TEST(Extruder, ASensorNoLongerFittedIsNoReasonToStayInFault) {
  Desk desk;
  bring_to(desk, State::kReady);
  desk.hot_end.set_sensor(SensorWiring::kOpen);
  desk.run_ms(500);
  ASSERT_EQ(desk.extruder.fault(), Fault::kSensorOpen);
  EXPECT_TRUE(desk.extruder.idle());
  desk.settings.set(Setting::kHeaterFitted, 0);
  EXPECT_EQ(desk.extruder.clear_fault(desk.now_ms), Reason::kNone);
  EXPECT_EQ(desk.extruder.state(), State::kStandby);
  EXPECT_TRUE(desk.extruder.idle());
}

// Whatever is asked, in whatever order: filament moves only hot and open, counts are exact, silence
// ends motion, and the heater is off in every state that says so.
TEST(Extruder, InvariantsHoldOverRandomCommands) {
  std::mt19937 engine(5);
  const auto random = [&engine] { return static_cast<uint32_t>(engine()); };
  for (int life = 0; life < 60; ++life) {
    Desk desk;
    desk.settings.set(Setting::kModuleTravel, 50);
    desk.hot_end.set_temperature(205);
    desk.run_ms(200);
    uint32_t silent_ms = 0;
    for (int act = 0; act < 300; ++act) {
      const uint32_t what = random() % 16;
      if (what < 12) {
        const int32_t arguments[] = {0, 2050, 500, 1000, 20000, -1};
        command(desk, static_cast<uint8_t>(70 + what % 6), arguments[random() % 6]);
      } else if (what == 12) {
        desk.extruder.clear_fault(desk.now_ms);
      } else if (what == 13 && random() % 4 == 0) {
        desk.hot_end.set_temperature(150 + random() % 70);
      } else if (what == 14) {
        desk.silent = random() % 3 == 0;
      }
      for (uint32_t ms = random() % 200; ms > 0; --ms) {
        const int64_t before = desk.timer.position();
        desk.run_ms(1);
        silent_ms = desk.silent ? silent_ms + 1 : 0;
        const State state = desk.extruder.state();
        ASSERT_EQ(desk.extruder.position(), desk.timer.position());
        ASSERT_GE(desk.extruder.retracted(), 0);
        if (state == State::kFault || state == State::kClosed || state == State::kStandby) {
          ASSERT_FALSE(desk.heater.heating());
          ASSERT_FALSE(desk.feeder.moving());
        }
        if (desk.timer.position() != before) {
          ASSERT_TRUE(state != State::kClosed && state != State::kStandby);
          ASSERT_LE(silent_ms, 602u);
          ASSERT_EQ(desk.extruder.module(), Module::kOpen);
        }
      }
    }
  }
}

}  // namespace
}  // namespace reforge::firmware

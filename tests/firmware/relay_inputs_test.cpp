// M70-M75 by the CNC's relays.

#include "firmware/arduino-extruder/relay_inputs.h"

#include <gtest/gtest.h>

#include "tests/firmware/desk.h"

namespace reforge::firmware {
namespace {

using wire::Fault;
using wire::Setting;
using wire::State;

struct Wired : Desk {
  Wired() {
    settings.set(Setting::kInStream, 1);
    silent = true;  // no host at all
    hot_end.set_temperature(205);
    run_ms(200);
  }
  void open() {
    levels.open = true;
    levels.running = true;
    run_ms(4000);
  }
};

TEST(RelayInputs, APrintingCycleByRelaysAlone) {
  Wired desk;
  EXPECT_TRUE(desk.extruder.run_permitted());
  desk.levels.open = true;
  desk.levels.running = true;
  desk.run_ms(20);
  EXPECT_FALSE(desk.relays.ready());
  desk.run_ms(4000);
  EXPECT_EQ(desk.extruder.state(), State::kReady);
  EXPECT_TRUE(desk.relays.ready());
  desk.levels.extrude = true;
  desk.run_ms(1000);
  EXPECT_EQ(desk.extruder.state(), State::kExtruding);
  desk.levels.extrude = false;
  desk.run_ms(50);
  EXPECT_NEAR(desk.extruder.position(), 147, 3);  // 0.35 mm/s for a second
  desk.levels.retract = true;
  desk.run_ms(20);
  desk.levels.retract = false;  // back at once: the length is counted, not timed
  desk.run_ms(500);
  EXPECT_EQ(desk.extruder.state(), State::kReady);
  EXPECT_EQ(desk.extruder.retracted(), 420);
  desk.levels.open = false;
  desk.run_ms(2000);
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
  EXPECT_EQ(desk.extruder.fault(), Fault::kNone);
}

TEST(RelayInputs, ABouncingRelayIsNoOrder) {
  Wired desk;
  for (int i = 0; i < 100; ++i) {
    desk.levels.open = i % 2 == 0;
    desk.run_ms(4);
  }
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
}

TEST(RelayInputs, WithoutTheSettingRelaysMeanNothing) {
  Wired desk;
  desk.settings.set(Setting::kInStream, 0);
  desk.levels = {true, true, true, true};
  desk.run_ms(1000);
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
}

TEST(RelayInputs, ExtrudeAndRetractTogetherIsAFault) {
  Wired desk;
  desk.open();
  desk.levels.extrude = desk.levels.retract = true;
  desk.run_ms(50);
  EXPECT_EQ(desk.extruder.fault(), Fault::kInputConflict);
}

TEST(RelayInputs, ExtrudingNeedsARunningCnc) {
  Wired desk;
  desk.open();
  desk.levels.running = false;
  desk.run_ms(50);
  desk.levels.extrude = true;
  desk.run_ms(50);
  EXPECT_EQ(desk.extruder.fault(), Fault::kCncStopped);

  Wired stopped;
  stopped.open();
  stopped.levels.extrude = true;
  stopped.run_ms(500);
  stopped.levels.running = false;
  stopped.run_ms(50);
  EXPECT_EQ(stopped.extruder.fault(), Fault::kCncStopped);
  EXPECT_FALSE(stopped.feeder.moving());
  EXPECT_FALSE(stopped.relays.ready());
}

TEST(RelayInputs, ExtrudingBeforeItIsReadyIsAFault) {
  Wired desk;
  desk.levels.open = true;
  desk.levels.running = true;
  desk.run_ms(100);
  desk.levels.extrude = true;
  desk.run_ms(50);
  EXPECT_EQ(desk.extruder.fault(), Fault::kRefusedInput);

  Wired closed;
  closed.levels.retract = true;
  closed.run_ms(50);
  EXPECT_EQ(closed.extruder.fault(), Fault::kRefusedInput);
}

TEST(RelayInputs, ABrokenOpenWireClosesTheModule) {
  Wired desk;
  desk.open();
  desk.levels.extrude = true;
  desk.run_ms(500);
  desk.levels = {false, false, false, true};
  desk.run_ms(2500);
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
  EXPECT_FALSE(desk.heater.heating());
}

TEST(RelayInputs, NothingIsRepeatedAfterAFaultIsCleared) {
  Wired desk;
  desk.open();
  desk.levels.extrude = true;
  desk.run_ms(500);
  desk.extruder.fault(Fault::kInternal);
  desk.run_ms(50);
  desk.extruder.clear_fault(desk.now_ms);
  desk.run_ms(500);
  EXPECT_EQ(desk.extruder.state(), State::kStandby);
  desk.levels.extrude = false;
  desk.levels.open = false;
  desk.run_ms(2500);
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
}

}  // namespace
}  // namespace reforge::firmware

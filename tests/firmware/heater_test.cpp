// Thermistor table, regulation and every cut-off of the heater.

#include "firmware/arduino-extruder/heater.h"

#include <gtest/gtest.h>

#include <cmath>

#include "firmware/arduino-extruder/limits.h"
#include "firmware/arduino-extruder/thermistor.h"
#include "tools/rig/hot_end.h"

namespace reforge::firmware {
namespace {

using wire::Fault;
using wire::Setting;

TEST(Thermistor, TableAgreesWithTheDataSheetsFormula) {
  HotEnd hot_end;
  for (double celsius = 10; celsius <= 300; celsius += 0.5) {
    hot_end.set_temperature(celsius);
    const double code = hot_end.sensor_mv(kCodeMax);
    EXPECT_NEAR(temperature_of(static_cast<uint16_t>(std::lround(code))) / 10.0, celsius,
                celsius < 30 ? 1.5 : 0.5);
  }
}

TEST(Thermistor, HotterIsNeverReadAsColder) {
  int16_t before = 32767;
  for (uint16_t code = kCodeShort; code <= kCodeOpen; ++code) {
    const int16_t temperature = temperature_of(code);
    ASSERT_LE(temperature, before) << code;
    before = temperature;
  }
}

// A heater before a hot end that really warms up, or does not.
struct Rig {
  Settings settings;
  Heater heater{settings};
  HotEnd hot_end;
  uint32_t now_ms = 0;
  bool on = false;
  bool sampling = true;

  // Returns the first fault, having switched off as the extruder would.
  Fault run(uint32_t ms) {
    for (uint32_t i = 0; i < ms; ++i) {
      ++now_ms;
      if (sampling) heater.sample(static_cast<uint16_t>(hot_end.sensor_mv(1023) + 0.5), now_ms);
      if (now_ms % 10 == 0) on = heater.slot() && heater.heating();
      hot_end.advance(0.001, on);
      const Fault fault = heater.check(now_ms);
      if (fault != Fault::kNone) {
        heater.off();
        return fault;
      }
    }
    return Fault::kNone;
  }
};

TEST(Heater, ReachesItsTargetWithoutMuchOvershoot) {
  Rig rig;
  rig.run(200);
  rig.heater.set_target(2050, rig.now_ms);
  double highest = 0;
  for (int s = 0; s < 300; ++s) {
    ASSERT_EQ(rig.run(1000), Fault::kNone);
    highest = std::max(highest, rig.hot_end.block_c());
  }
  EXPECT_TRUE(rig.heater.at_target());
  EXPECT_LT(highest, 212);
  EXPECT_NEAR(rig.hot_end.block_c(), 205, 1.5);
  EXPECT_NEAR(rig.heater.temperature(), 2050, 15);
}

TEST(Heater, HoldsItsTargetUnderAFan) {
  Rig rig;
  rig.hot_end.set_temperature(205);
  rig.run(200);
  rig.heater.set_target(2050, rig.now_ms);
  ASSERT_EQ(rig.run(60'000), Fault::kNone);
  rig.hot_end.set_loss(0.14);
  ASSERT_EQ(rig.run(120'000), Fault::kNone);
  EXPECT_NEAR(rig.hot_end.block_c(), 205, 2);
}

TEST(Heater, OffMeansNoSlotIsOn) {
  Rig rig;
  rig.run(200);
  rig.heater.set_target(2050, rig.now_ms);
  rig.run(1000);
  EXPECT_TRUE(rig.on);
  rig.heater.off();
  for (int i = 0; i < 1000; ++i) {
    rig.run(1);
    ASSERT_FALSE(rig.heater.slot());
  }
}

TEST(Heater, CutsOffWhenTheSensorIsOpenOrShort) {
  // Wherever in a window it happens: the mean of a good and a bad part is no temperature.
  for (uint32_t phase = 0; phase < 64; phase += 3)
    for (const auto& [wiring, expected] : {std::pair{SensorWiring::kOpen, Fault::kSensorOpen},
                                           std::pair{SensorWiring::kShort, Fault::kSensorShort}}) {
      Rig rig;
      rig.hot_end.set_temperature(205);
      rig.run(200);
      rig.heater.set_target(2050, rig.now_ms);
      ASSERT_EQ(rig.run(10'000 + phase), Fault::kNone);
      rig.hot_end.set_sensor(wiring);
      const uint32_t before = rig.now_ms;
      EXPECT_EQ(rig.run(10'000), expected);
      EXPECT_LE(rig.now_ms - before, 300u);
      EXPECT_EQ(rig.heater.temperature(), wire::kTemperatureUnknown);
      EXPECT_FALSE(rig.heater.warm(0));
    }
}

TEST(Heater, AnOpenSensorIsNoFaultWhileCold) {
  Rig rig;
  rig.hot_end.set_sensor(SensorWiring::kOpen);
  EXPECT_EQ(rig.run(5000), Fault::kNone);
  rig.heater.set_target(2050, rig.now_ms);
  EXPECT_EQ(rig.run(5000), Fault::kSensorOpen);
}

TEST(Heater, CutsOffAboveTheMaximumEvenWhenNotHeating) {
  Rig rig;
  rig.hot_end.set_temperature(277);
  EXPECT_EQ(rig.run(1000), Fault::kOverTemperature);
}

TEST(Heater, CutsOffWithoutRise) {
  Rig rig;
  rig.hot_end.set_heater_power(0);
  rig.run(200);
  rig.heater.set_target(2050, rig.now_ms);
  EXPECT_EQ(rig.run(60'000), Fault::kNoRise);
  EXPECT_NEAR(rig.now_ms, 20'200, 200);
}

TEST(Heater, AFallenOutSensorIsNoRise) {
  Rig rig;
  rig.run(200);
  rig.heater.set_target(2050, rig.now_ms);
  rig.run(15'000);
  rig.hot_end.set_sensor(SensorWiring::kFallenOut);
  EXPECT_EQ(rig.run(60'000), Fault::kNoRise);
}

TEST(Heater, CutsOffWhenItRunsAway) {
  Rig rig;
  rig.hot_end.set_temperature(205);
  rig.run(200);
  rig.heater.set_target(2050, rig.now_ms);
  ASSERT_EQ(rig.run(20'000), Fault::kNone);
  rig.hot_end.set_heater_power(0);
  const uint32_t before = rig.now_ms;
  EXPECT_EQ(rig.run(120'000), Fault::kRunaway);
  EXPECT_GT(rig.now_ms - before, 40'000u);
  EXPECT_LT(rig.now_ms - before, 46'000u);
}

TEST(Heater, AShortDipIsNoRunaway) {
  Rig rig;
  rig.hot_end.set_temperature(205);
  rig.run(200);
  rig.heater.set_target(2050, rig.now_ms);
  ASSERT_EQ(rig.run(20'000), Fault::kNone);
  rig.hot_end.set_temperature(195);
  EXPECT_EQ(rig.run(120'000), Fault::kNone);
}

TEST(Heater, ADeadConverterIsAFault) {
  Rig rig;
  rig.run(200);
  rig.sampling = false;
  EXPECT_EQ(rig.run(5000), Fault::kNone);
  rig.heater.set_target(2050, rig.now_ms);
  EXPECT_EQ(rig.run(5000), Fault::kInternal);
}

TEST(Heater, WithoutAHeaterNothingIsKnownAndNothingCut) {
  Rig rig;
  rig.settings.set(Setting::kHeaterFitted, 0);
  rig.hot_end.set_temperature(290);
  EXPECT_EQ(rig.run(5000), Fault::kNone);
  EXPECT_EQ(rig.heater.temperature(), wire::kTemperatureUnknown);
  EXPECT_TRUE(rig.heater.warm(0));
}

TEST(Heater, CoolsToALowerTargetWithoutAFault) {
  Rig rig;
  rig.hot_end.set_temperature(240);
  rig.run(200);
  rig.heater.set_target(1900, rig.now_ms);
  EXPECT_EQ(rig.run(200'000), Fault::kNone);
  EXPECT_TRUE(rig.heater.at_target());
}

TEST(Heater, NoisyHotReadingsStayInsideTheArithmetic) {
  Rig rig;
  rig.settings.set(Setting::kPidP, 20000);
  rig.settings.set(Setting::kPidI, 5000);
  rig.settings.set(Setting::kPidD, 50000);
  rig.heater.set_target(2600, 0);
  for (int i = 0; i < 2000; ++i) {
    rig.hot_end.set_temperature(i % 2 ? 274 : 1);
    rig.now_ms += 64;
    for (int n = 0; n < 64; ++n) {
      rig.heater.sample(static_cast<uint16_t>(rig.hot_end.sensor_mv(1023)), rig.now_ms);
    }
    rig.heater.slot();
  }
}

}  // namespace
}  // namespace reforge::firmware

// Every number the firmware decides by. What differs from rig to rig is a setting with a default
// and bounds; what is physics or board is a constant.
//
// Units as in extruder_wire.h: 0.1 C, um, um/s, ms, microsteps.
#pragma once

#include <stdint.h>

#include "firmware/arduino-extruder/flash.h"
#include "protocols/extruder_wire.h"

namespace reforge {
namespace firmware {

constexpr uint8_t kVersionMajor = 0;
constexpr uint8_t kVersionMinor = 1;
constexpr uint8_t kVersionPatch = 0;

struct SettingLimits {
  int32_t preset;
  int32_t least;
  int32_t most;
};

// In the order of wire::Setting; read with flash_i32.
constexpr SettingLimits kSettingLimits[wire::kSettingCount] REFORGE_FLASH = {
    {420000, 1000, 5000000},   // kStepsPerMetre
    {350, 1, 100000},          // kFilamentSpeed
    {200000, 1000, 2000000},   // kAcceleration
    {1000, 0, 20000},          // kRetractLength
    {25000, 100, 100000},      // kRetractSpeed
    {2050, 500, 3000},         // kTargetTemperature
    {1700, 500, 3000},         // kMinimumTemperature
    {2750, 500, 3000},         // kMaximumTemperature
    {1, 0, 1},                 // kHeaterFitted
    {3000, 500, 60000},        // kSilence
    {500, 100, 10000},         // kExtrusionSilence
    {1500, 0, 30000},          // kModuleTravel
    {2000, 500, 2500},         // kServoOpen
    {1000, 500, 2500},         // kServoClosed
    {0, 0, 1},                 // kFilamentSensor
    {0, 0, 1},                 // kReverseDirection
    {650, 0, 20000},           // kPidP
    {25, 0, 5000},             // kPidI
    {2200, 0, 50000},          // kPidD
    {20, 5, 200},              // kRiseTemperature
    {20000, 5000, 120000},     // kRiseTime
    {40, 10, 500},             // kRunawayTemperature
    {40000, 2000, 120000},     // kRunawayTime
    {300000, 10000, 1200000},  // kHeatUpTime
    {0, 0, 1},                 // kInStream
    {120000, 10000, 600000},   // kTextSilence
};

// Motion.
constexpr uint32_t kTimerHz = 2000000;    // step timer
constexpr uint32_t kStepRateMax = 20000;  // microsteps/s the interrupt keeps up with
constexpr uint32_t kRateQ8Min = 256;      // one microstep/s
constexpr int32_t kSpeedMax = 100000;     // um/s an argument may ask for
constexpr int32_t kLengthMax = 200000;    // um, M72 with a length
constexpr int32_t kRetractMax = 20000;    // um
constexpr uint32_t kStepRateStart =
    200;  // microsteps/s any motor starts and stops at without a ramp

// Heat.
constexpr int16_t kTargetMargin = 150;      // a target stays this far below the cut-off
constexpr int16_t kAtTargetBand = 20;       // "at temperature" within this ...
constexpr uint16_t kAtTargetTime = 1000;    // ... for this long
constexpr int16_t kIntegralBand = 100;      // the integral works only this near the target
constexpr int16_t kColdMargin = 50;         // moving filament this far below the minimum is a fault
constexpr uint16_t kSamplingSilence = 500;  // without a reading for this long the converter is dead
constexpr uint8_t kSensorBadWindows = 3;    // readings in a row (64 ms each) before a sensor fault
constexpr uint16_t kReadingSpread = 60;     // of 1023, between the readings of one window

// Inputs.
constexpr uint8_t kDebounce = 10;  // ms an input must stand still
constexpr uint8_t kFrameGap = 20;  // ms without a byte that end a frame begun

}  // namespace firmware
}  // namespace reforge

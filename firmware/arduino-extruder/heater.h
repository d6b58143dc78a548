// Heats the nozzle to a target and knows when it may not.
//
// Readings come in one a millisecond; every 64 make one window: temperature, checks, PID. The
// integral is bounded by full power and works near the target only. Cut-offs (RIG.md, "Heater
// practice"): sensor open or short while heating, over-temperature always, no rise, runaway, dead
// converter. The caller latches the fault and switches off. Without a heater (setting) the
// temperature is unknown and nothing is checked.
#pragma once

#include <stdint.h>

#include "firmware/arduino-extruder/settings.h"
#include "protocols/extruder_wire.h"

namespace reforge {
namespace firmware {

class Heater {
 public:
  explicit Heater(const Settings& settings) : settings_(settings) {}

  void set_target(int16_t tenths, uint32_t now_ms);  // > 0
  void off();
  bool heating() const { return target_ > 0; }
  int16_t target() const { return target_; }

  void sample(uint16_t reading, uint32_t now_ms);  // ten bits
  wire::Fault check(uint32_t now_ms);              // what must be cut off for, now

  bool fitted() const { return settings_.get(wire::Setting::kHeaterFitted) != 0; }
  int16_t temperature() const {
    return temperature_;
  }  // kTemperatureUnknown: no believable reading
  bool at_target() const { return at_target_; }
  // Warm enough to move filament, with some margin below the minimum.
  bool warm(int16_t margin) const;
  bool slot();  // every 10 ms: whether the heater is on for the next slot

 private:
  void window(uint16_t code, uint32_t now_ms);
  void regulate();
  void watch(uint32_t now_ms);

  const Settings& settings_;
  int16_t target_ = 0;
  int16_t temperature_ = wire::kTemperatureUnknown;
  wire::Fault fault_ = wire::Fault::kNone;  // found by the last window

  // Readings.
  uint16_t sum_ = 0;
  uint8_t readings_ = 0;
  uint16_t least_ = 0, most_ = 0;
  uint8_t bad_windows_ = 0;
  uint32_t window_ms_ = 0;  // when the last window closed

  // Regulation.
  int32_t integral_ = 0;  // sum of I * error over windows
  int16_t slope_ = 0;     // 0.1 C/s, smoothed
  uint8_t power_ = 0;     // of 255
  uint8_t slot_rest_ = 0;

  // Watching.
  bool reached_ = false;  // the target's runaway band was entered
  bool at_target_ = false;
  uint32_t in_band_since_ = 0;
  bool in_band_ = false;
  int16_t rise_from_ = 0;    // temperature at the start of the rise window ...
  uint32_t rise_since_ = 0;  // ... and when; or when the target was last held
};

}  // namespace firmware
}  // namespace reforge

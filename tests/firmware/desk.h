// The firmware's logic on the host: the same objects main.cpp has, a millisecond loop, a step
// timer, a memory for the EEPROM. Temperature is set by hand.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "firmware/arduino-extruder/extruder.h"
#include "firmware/arduino-extruder/feeder.h"
#include "firmware/arduino-extruder/heater.h"
#include "firmware/arduino-extruder/limits.h"
#include "firmware/arduino-extruder/link.h"
#include "firmware/arduino-extruder/relay_inputs.h"
#include "firmware/arduino-extruder/settings.h"
#include "firmware/arduino-extruder/store.h"
#include "protocols/extruder_wire.h"
#include "tools/rig/hot_end.h"

namespace reforge {

// Runs a feeder's timer as the board would: in ticks of firmware::kTimerHz.
class StepTimer {
 public:
  explicit StepTimer(firmware::Feeder& feeder) : feeder_(feeder) {}
  void run(uint32_t ticks);
  // Ticks since the beginning at which steps were made; kept until forgotten.
  void forget_steps() { steps_.clear(); }
  const std::vector<uint64_t>& steps() const { return steps_; }
  int64_t position() const { return position_; }

 private:
  firmware::Feeder& feeder_;
  uint64_t now_ = 0;
  uint64_t due_ = 0;
  bool armed_ = false;
  int64_t position_ = 0;  // counted on the pins, not by the feeder
  std::vector<uint64_t> steps_;
};

class Desk {
 public:
  Desk();

  void run_ms(uint32_t ms);  // refreshed every 100 ms unless `silent`
  uint32_t now_ms = 0;
  bool silent = false;
  bool filament = true;
  bool by_link = false;  // the link takes part; set by whatever is sent over it
  firmware::Levels levels = {false, false, false, false};
  HotEnd hot_end;  // set_temperature, set_sensor; it does not heat by itself
  bool heater_on = false;

  // By the link.
  void send(const wire::Frame& frame);
  void send_text(const std::string& text);
  void greet();  // hello, and its banner taken
  std::vector<wire::Frame> take_frames();
  std::string take_text();
  // Or all bytes as they came, for a host of its own; from the first call of tap() on.
  void tap() { tapped_ = true; }
  std::string take_bytes();

  // M70 at 205 C, done.
  void open_hot();

  firmware::Settings settings;
  firmware::Feeder feeder;
  firmware::Heater heater{settings};
  firmware::Extruder extruder{settings, feeder, heater};
  firmware::RelayInputs relays{settings, extruder};
  firmware::Store store;
  firmware::Output out;
  firmware::Link link;
  StepTimer timer{feeder};

  static std::array<uint8_t, 1024> eeprom;  // shared: the store's functions have no object

 private:
  void drain();

  wire::Decoder decoder_;
  std::vector<wire::Frame> frames_;
  std::string text_;
  bool tapped_ = false;
  std::string bytes_;
  uint32_t slot_ms_ = 0;
};

}  // namespace reforge

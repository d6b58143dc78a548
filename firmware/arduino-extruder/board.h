// The UNO R3: the one place that knows registers. Everything else is logic that also runs on the
// host.
//
//   D0 D1  serial, 115200 baud          D9   STEP
//   D4     filament switch to ground    D8   DIR (high feeds, unless reversed)
//   D5     ready, to the CNC            D7   driver ENABLE, low = on
//   D6     heater MOSFET                D10  module servo
//   A0     thermistor, 4.7 kohm to 5 V  D11  module relay
//   A1-A4  CNC relays to ground: open,  D12  run permitted (hold), energised = the CNC may run
//          extrude, retract, running    D13  lamp: fault
//
// Timer 1: steps (0.5 us) and servo pulse; timer 2: milliseconds. Heater, relay, run permitted and
// ready need pull-downs, ENABLE a pull-up, so that they are safe while the chip is in reset.
#pragma once

#include <stdint.h>

#include "firmware/arduino-extruder/feeder.h"
#include "firmware/arduino-extruder/ring.h"
#include "firmware/arduino-extruder/store.h"

namespace reforge {
namespace firmware {
namespace board {

struct Outputs {
  bool heater_on;
  bool motor_enabled;
  bool relay_open;
  uint16_t servo_pulse_us;  // 0: not driven
  bool run_permitted;
  bool ready;
  bool lamp;
};

struct Inputs {
  bool filament_present;
  bool open, extrude, retract, running;
};

void begin(Feeder& feeder);  // all outputs safe; interrupts and watchdog on
uint8_t reset_cause();

void apply(const Outputs& outputs);
Inputs inputs();

// Milliseconds since the last call (at most 255).
uint8_t elapsed_ms();
// Starts a conversion of the thermistor; true with the reading of the one before when it has ended.
bool thermistor_reading(uint16_t& reading);
void start_steps(bool reversed);  // after Feeder::take_start()
void start_servo_pulse();         // every 20 ms

bool receive(uint8_t& byte);
Ring<128>& transmit_ring();
void start_transmit();  // after anything was put into the ring

Eeprom eeprom();
void feed_watchdog();
void sleep_until_interrupt();  // returns at once if something waits to be handled

}  // namespace board
}  // namespace firmware
}  // namespace reforge

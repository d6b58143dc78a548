// The extruder board's main loop: bytes in, a millisecond's duties, pins out, sleep.

#include "firmware/arduino-extruder/board.h"
#include "firmware/arduino-extruder/extruder.h"
#include "firmware/arduino-extruder/feeder.h"
#include "firmware/arduino-extruder/heater.h"
#include "firmware/arduino-extruder/limits.h"
#include "firmware/arduino-extruder/link.h"
#include "firmware/arduino-extruder/relay_inputs.h"
#include "firmware/arduino-extruder/settings.h"
#include "firmware/arduino-extruder/store.h"

namespace {

using namespace reforge;
using namespace reforge::firmware;

Settings g_settings;
Feeder g_feeder;
Heater g_heater(g_settings);
Extruder g_extruder(g_settings, g_feeder, g_heater);
RelayInputs g_relays(g_settings, g_extruder);
Store g_store(board::eeprom());
Link g_link(g_settings, g_store, g_extruder, g_heater, board::transmit_ring(),
            board::reset_cause());

// The watchdog is fed only after each of these ran since it was fed last.
constexpr uint8_t kDutyLink = 1;
constexpr uint8_t kDutyExtruder = 2;
constexpr uint8_t kDutySampling = 4;
constexpr uint8_t kDutyOutputs = 8;
constexpr uint8_t kAllDuties = 15;

uint16_t servo_pulse() {
  switch (g_extruder.module()) {
    case Module::kOpen:
      return static_cast<uint16_t>(g_settings.get(wire::Setting::kServoOpen));
    case Module::kClosed:
      return static_cast<uint16_t>(g_settings.get(wire::Setting::kServoClosed));
    case Module::kLimp:
      break;
  }
  return 0;
}

void apply_outputs(bool heater_slot) {
  const wire::State state = g_extruder.state();
  const bool fault = state == wire::State::kFault;
  board::apply({heater_slot && g_heater.heating(), state != wire::State::kClosed && !fault,
                g_extruder.module() == Module::kOpen, servo_pulse(), g_extruder.run_permitted(),
                g_relays.ready(), fault});
}

void start_motor() {
  if (g_feeder.take_start()) {
    board::start_steps(g_settings.get(wire::Setting::kReverseDirection) != 0);
  }
}

}  // namespace

int main() {
  board::begin(g_feeder);
  g_store.load(g_settings);

  uint32_t now_ms = 0;
  uint8_t duties = 0;
  uint8_t slot_ms = 0, servo_ms = 0;
  bool heater_slot = false;
  for (;;) {
    uint8_t byte;
    while (board::receive(byte)) {
      g_link.receive(byte, now_ms);
      start_motor();
      board::start_transmit();
    }

    // A loop that took longer than a millisecond makes up for the missed ones.
    for (uint8_t elapsed = board::elapsed_ms(); elapsed > 0; --elapsed) {
      ++now_ms;
      const board::Inputs in = board::inputs();
      g_relays.tick({in.open, in.extrude, in.retract, in.running}, now_ms);
      uint16_t reading;
      if (board::thermistor_reading(reading)) {
        g_heater.sample(reading, now_ms);
        duties |= kDutySampling;
      }
      g_extruder.tick(in.filament_present, now_ms);
      duties |= kDutyExtruder;
      g_link.tick(now_ms);
      duties |= kDutyLink;
      if (++slot_ms >= 10) {
        slot_ms = 0;
        heater_slot = g_heater.slot();
      }
      if (++servo_ms >= 20) {
        servo_ms = 0;
        board::start_servo_pulse();
      }
    }

    apply_outputs(heater_slot);
    start_motor();
    board::start_transmit();
    duties |= kDutyOutputs;
    if (duties == kAllDuties) {
      board::feed_watchdog();
      duties = 0;
    }
    board::sleep_until_interrupt();
  }
}

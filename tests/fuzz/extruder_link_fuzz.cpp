// Whatever reaches the extruder board, its outputs stay safe. The input is a script: 0xFF lets a
// tenth of a second pass, 0xFE makes a whole frame of what follows (type, payload length and
// payload; sequence and CRC are right), 0xFD sets the nozzle's temperature, any other byte is sent
// as it is.

#include <cstddef>
#include <cstdint>
#include <cstdlib>

#include "tests/firmware/desk.h"

using namespace reforge;

namespace {

struct Script {
  const uint8_t* data;
  size_t left;
  uint8_t next() {
    if (left == 0) return 0;
    --left;
    return *data++;
  }
};

void run(Desk& desk, uint32_t ms) {
  for (; ms > 0; --ms) {
    const int64_t before = desk.timer.position();
    desk.run_ms(1);
    const wire::State state = desk.extruder.state();
    const bool cold = state == wire::State::kFault || state == wire::State::kClosed ||
                      state == wire::State::kStandby;
    const bool moved = desk.timer.position() != before;
    if (cold && (desk.heater.heating() || desk.feeder.moving())) std::abort();
    if (moved && desk.extruder.module() != firmware::Module::kOpen) std::abort();
    if (state == wire::State::kFault && desk.extruder.run_permitted()) std::abort();
    if (desk.extruder.position() != desk.timer.position()) std::abort();
    if (desk.extruder.retracted() < 0) std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  Desk desk;
  desk.silent = true;
  desk.settings.set(wire::Setting::kModuleTravel, 50);
  desk.hot_end.set_temperature(205);
  desk.run_ms(200);
  desk.greet();
  uint8_t sequence = 0;
  Script script = {data, size};
  while (script.left > 0) {
    const uint8_t what = script.next();
    if (what == 0xFF) {
      run(desk, 100);
    } else if (what == 0xFE) {
      wire::Frame frame;
      frame.type = static_cast<wire::Type>(script.next());
      frame.length = script.next() % 8;
      for (uint8_t i = 0; i < frame.length; ++i) frame.payload[i] = script.next();
      frame.sequence = ++sequence;
      desk.send(frame);
      run(desk, 2);
    } else if (what == 0xFD) {
      desk.hot_end.set_temperature(script.next());
    } else {
      desk.link.receive(what, desk.now_ms);
    }
  }
  return 0;
}

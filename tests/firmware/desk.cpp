#include "tests/firmware/desk.h"

#include <utility>

namespace reforge {

std::array<uint8_t, 1024> Desk::eeprom = {};

void StepTimer::run(uint32_t ticks) {
  const uint64_t end = now_ + ticks;
  if (feeder_.take_start()) {
    armed_ = true;
    due_ = now_ + 20;
  }
  while (armed_ && due_ <= end) {
    now_ = due_;
    if (feeder_.due()) {
      steps_.push_back(now_);
      position_ += feeder_.backward() ? -1 : 1;
    }
    const uint16_t wait = feeder_.next();
    armed_ = wait != 0;
    due_ = now_ + wait;
  }
  now_ = end;
}

Desk::Desk()
    : store({[](uint16_t address) { return eeprom[address]; }, [] { return true; },
             [](uint16_t address, uint8_t value) { eeprom[address] = value; }}),
      link(settings, store, extruder, heater, out, wire::kResetPowerOn) {}

void Desk::run_ms(uint32_t ms) {
  for (uint32_t i = 0; i < ms; ++i) {
    ++now_ms;
    if (!silent && now_ms % 100 == 0) extruder.refresh(firmware::Authority::kHost, now_ms);
    relays.tick(levels, now_ms);
    heater.sample(static_cast<uint16_t>(hot_end.sensor_mv(1023)), now_ms);
    extruder.tick(filament, now_ms);
    if (by_link) link.tick(now_ms);
    if (++slot_ms_ % 10 == 0) heater_on = heater.slot() && heater.heating();
    timer.run(firmware::kTimerHz / 1000);
    drain();
  }
}

void Desk::send(const wire::Frame& frame) {
  by_link = true;
  uint8_t bytes[wire::kFrameMax];
  const uint8_t count = encode(frame, bytes);
  for (uint8_t i = 0; i < count; ++i) link.receive(bytes[i], now_ms);
  drain();
}

void Desk::send_text(const std::string& text) {
  by_link = true;
  for (const char c : text) link.receive(static_cast<uint8_t>(c), now_ms);
  drain();
}

void Desk::greet() {
  send(pack(wire::Hello{wire::kProtocolVersion, 7}, 0));
  frames_.clear();
}

void Desk::drain() {
  uint8_t byte;
  while (out.pop(byte)) {
    if (tapped_) {
      bytes_ += static_cast<char>(byte);
      continue;
    }
    if (!decoder_.push(byte)) text_ += static_cast<char>(byte);
    wire::Frame frame;
    while (decoder_.take(frame)) frames_.push_back(frame);
  }
}

std::vector<wire::Frame> Desk::take_frames() {
  return std::exchange(frames_, {});
}
std::string Desk::take_bytes() {
  return std::exchange(bytes_, {});
}
std::string Desk::take_text() {
  return std::exchange(text_, {});
}

void Desk::open_hot() {
  hot_end.set_temperature(205);
  run_ms(200);
  extruder.command(70, 2050, now_ms);
  run_ms(4000);
  wire::Reason reason;
  extruder.take_finished(reason);
}

}  // namespace reforge

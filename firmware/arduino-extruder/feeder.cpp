#include "firmware/arduino-extruder/feeder.h"

#include "firmware/arduino-extruder/critical.h"
#include "firmware/arduino-extruder/limits.h"

namespace reforge {
namespace firmware {
namespace {

constexpr uint32_t kStartQ8 = kStepRateStart * 256;

// kTimerHz / rate in Q8 ticks: (Hz * 2^16) / rate_q8 without a 64-bit division. Fits for rates of
// 1/8 step/s and more.
uint32_t interval_q8(uint32_t rate_q8) {
  const uint32_t dividend = kTimerHz * 256;
  const uint32_t quotient = dividend / rate_q8;
  const uint32_t rest = dividend % rate_q8;  // below 2^24: rates end at kStepRateMax
  return quotient * 256 + rest * 256 / rate_q8;
}

uint32_t smaller(uint32_t a, uint32_t b) {
  return a < b ? a : b;
}

}  // namespace

void Feeder::set_acceleration(uint32_t steps_per_s2) {
  acceleration_ = steps_per_s2 > 0 ? steps_per_s2 : 1;
  const uint32_t gained = acceleration_ * 32 / 125;  // 256 / 1000
  ramp_step_q8_ = gained > 0 ? gained : 1;
}

void Feeder::run(uint32_t rate_q8) {
  direction_ = 1;
  counted_ = false;
  begin(rate_q8);
}

void Feeder::move(int32_t steps, uint32_t rate_q8) {
  if (steps == 0) return;
  direction_ = steps < 0 ? -1 : 1;
  remaining_ = static_cast<uint32_t>(steps < 0 ? -steps : steps);
  counted_ = true;
  begin(rate_q8);
}

// The interrupt is at rest here (running_ is false), so nothing needs guarding before the last
// line.
void Feeder::begin(uint32_t rate_q8) {
  target_q8_ = rate_q8;
  stopping_ = false;
  wait_ = 0;
  fraction_ = 0;
  rate_q8_ = smaller(rate_q8, kStartQ8);
  interval_q8_ = interval_q8(rate_q8_);
  start_ = true;
  Critical guard;
  running_ = true;
}

void Feeder::set_rate(uint32_t rate_q8) {
  rate_q8_ = rate_q8;
  const uint32_t interval = interval_q8(rate_q8);
  Critical guard;
  interval_q8_ = interval;
  if (wait_ > interval >> 8) wait_ = interval >> 8;  // faster now: do not sit out a slow wait
}

void Feeder::stop() {
  stopping_ = true;
}

void Feeder::halt() {
  Critical guard;
  running_ = false;
  start_ = false;
}

void Feeder::tick() {
  if (!running_) return;
  bool slow_down = stopping_;
  if (counted_ && !stopping_ && rate_q8_ > kStartQ8) {
    uint32_t remaining;
    {
      Critical guard;
      remaining = remaining_;
    }
    // v^2 / 2a steps to stop in, and those of the millisecond until the next look.
    const uint32_t rate = rate_q8_ >> 8;
    slow_down = remaining <= rate * rate / (2 * acceleration_) + rate / 1000 + 1;
  }
  if (slow_down) {
    const uint32_t floor_q8 = smaller(target_q8_, kStartQ8);
    if (rate_q8_ > floor_q8 + ramp_step_q8_) {
      set_rate(rate_q8_ - ramp_step_q8_);
    } else if (stopping_) {
      halt();
    } else if (rate_q8_ > floor_q8) {
      set_rate(floor_q8);
    }
  } else if (rate_q8_ < target_q8_) {
    set_rate(smaller(target_q8_, rate_q8_ + ramp_step_q8_));
  }
}

int32_t Feeder::position() const {
  Critical guard;
  return position_;
}

bool Feeder::take_start() {
  const bool start = start_;
  start_ = false;
  return start;
}

}  // namespace firmware
}  // namespace reforge

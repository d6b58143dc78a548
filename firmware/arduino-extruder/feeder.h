// The filament motor: which step when, in whole numbers. Counts are exact, whatever interrupts
// them.
//
// Rates are microsteps per second times 256 (Q8); waits are ticks of the step timer (kTimerHz). The
// main loop calls tick() every millisecond, which moves the rate along the ramp; the timer
// interrupt calls next(), which makes steps at the present rate, the fraction of a tick carried
// from step to step, so that the mean rate is exact to 2^-8 tick a step. Ramps are a staircase of 1
// ms; a counted move slows down in time and ends by its count alone.
#pragma once

#include <stdint.h>

namespace reforge {
namespace firmware {

class Feeder {
 public:
  // Main loop. Motion is started from rest only.
  void set_acceleration(uint32_t steps_per_s2);
  void run(uint32_t rate_q8);                  // forward until stop()
  void move(int32_t steps, uint32_t rate_q8);  // counted; negative pulls back
  void stop();                                 // ramp down to rest
  void halt();                                 // rest now
  void tick();                                 // every millisecond
  bool moving() const { return running_; }
  bool backward() const { return direction_ < 0; }
  int32_t position() const;
  // True once after a motion has begun: the timer must be started.
  bool take_start();

  // Timer interrupt: if due(), make a step now; then next() counts it and returns the ticks until
  // the next interrupt, 0 for none. In this order the step does not wait for the arithmetic.
  bool due() const { return running_ && wait_ == 0; }
  uint16_t next() {
    if (!running_) return 0;
    if (wait_ == 0) {
      position_ += direction_;
      if (counted_ && --remaining_ == 0) {
        running_ = false;
        return 0;
      }
      const uint32_t interval = interval_q8_ + fraction_;
      fraction_ = static_cast<uint8_t>(interval);
      wait_ = interval >> 8;
    }
    if (wait_ < 2 * kPart) {
      const uint16_t part = static_cast<uint16_t>(wait_);
      wait_ = 0;
      return part;
    }
    wait_ -= kPart;
    return kPart;
  }

 private:
  static constexpr uint16_t kPart = 1000;  // longer waits are cut into parts of 0.5 ms

  void begin(uint32_t rate_q8);
  void set_rate(uint32_t rate_q8);

  // Main loop only.
  uint32_t rate_q8_ = 0;
  uint32_t target_q8_ = 0;
  uint32_t acceleration_ = 1;  // steps/s^2
  uint32_t ramp_step_q8_ = 1;  // rate gained in 1 ms
  bool stopping_ = false;
  bool start_ = false;

  // Shared with the interrupt; touched by the main loop under Critical only (a bool is one byte).
  volatile bool running_ = false;
  bool counted_ = false;
  int8_t direction_ = 1;
  uint8_t fraction_ = 0;
  uint32_t interval_q8_ = 0;
  uint32_t wait_ = 0;
  uint32_t remaining_ = 0;
  int32_t position_ = 0;
};

}  // namespace firmware
}  // namespace reforge

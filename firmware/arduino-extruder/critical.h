// A scope during which no interrupt runs, for words shared with the step interrupt. On the host,
// where the logic is tested, there are no interrupts and it does nothing.
#pragma once

#ifdef __AVR__
#include <avr/interrupt.h>
#include <avr/io.h>
#endif

namespace reforge {
namespace firmware {

#ifdef __AVR__
class Critical {
 public:
  Critical() : sreg_(SREG) { cli(); }
  ~Critical() {
    __asm__ volatile("" ::: "memory");
    SREG = sreg_;
  }

 private:
  uint8_t sreg_;
};
#else
class Critical {
 public:
  Critical() {}
  ~Critical() {}
};
#endif

}  // namespace firmware
}  // namespace reforge

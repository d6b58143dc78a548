// Text for a person at a terminal: a line in, `ok` or `error <reason>` out (FORMATS.md, "Extruder
// link").
//
// M72 needs a length here, since a person sends no heartbeat. `ok` comes when the order has ended.
// Only a line that is understood is a sign of life: pieces of spoiled frames end up here as well.
#pragma once

#include <stdint.h>

#include "firmware/arduino-extruder/extruder.h"
#include "firmware/arduino-extruder/ring.h"

namespace reforge {
namespace firmware {

using Output = Ring<128>;

class Terminal {
 public:
  Terminal(const Settings& settings, Extruder& extruder, Output& out)
      : settings_(settings), extruder_(extruder), out_(out) {}

  void receive(uint8_t byte, uint32_t now_ms);
  void forget() { length_ = 0, waiting_ = false; }  // a host has taken over
  bool waiting() const { return waiting_; }
  void finished(wire::Reason reason);  // the order a line gave has ended

 private:
  void line(uint32_t now_ms);
  wire::Reason m_code(uint32_t now_ms);
  bool word(char letter, int32_t& thousandths) const;
  void answer(wire::Reason reason);
  void state();
  void print(const char* text);
  void print(int32_t number);

  static constexpr uint8_t kLineMax = 24;

  const Settings& settings_;
  Extruder& extruder_;
  Output& out_;
  char line_[kLineMax + 1] = {};
  uint8_t length_ = 0;  // kLineMax + 1: too long
  bool waiting_ = false;
};

}  // namespace firmware
}  // namespace reforge

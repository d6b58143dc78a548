// In-stream M-codes: the CNC's relays, debounced, as orders to the extruder.
//
// Four levels: open (M70 on, M71 off), extrude (M72/M73), retract (M74/M75), running. Falling edges
// of open and extrude act at once; retract and a rising extrude wait for the motion before them.
// What the state does not allow, extrude and retract together, and extruding while the CNC does not
// run are faults: the CNC cannot hear a refusal. `ready` goes back to the CNC for M-codes that
// wait.
#pragma once

#include <stdint.h>

#include "firmware/arduino-extruder/extruder.h"

namespace reforge {
namespace firmware {

struct Levels {
  bool open, extrude, retract, running;
};

class RelayInputs {
 public:
  RelayInputs(const Settings& settings, Extruder& extruder)
      : settings_(settings), extruder_(extruder) {}

  void tick(const Levels& raw, uint32_t now_ms);  // every millisecond, before Extruder::tick
  bool ready() const;

 private:
  class Debounced {
   public:
    bool tick(bool raw);

   private:
    bool level_ = false;
    uint8_t different_ = 0;
  };

  void order(uint8_t m_code, bool& acted, bool level, uint32_t now_ms);

  const Settings& settings_;
  Extruder& extruder_;
  Debounced inputs_[4];
  // What the extruder was last told.
  bool open_ = false;
  bool extrude_ = false;
  bool retract_ = false;
};

}  // namespace firmware
}  // namespace reforge

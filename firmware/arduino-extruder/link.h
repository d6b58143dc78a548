// The board's end of the extruder link (extruder_wire.h): bytes in, orders out, answers back.
//
// Keeps the rules of the wire: one outstanding order, duplicates answered and not executed, nothing
// before a hello. Answers go whole into a ring or not at all; a done, a banner and a fault report
// are kept until they fit, other answers the host asks for again. Text lines go to Terminal, and
// only while no host is alive.
#pragma once

#include <stdint.h>

#include "firmware/arduino-extruder/extruder.h"
#include "firmware/arduino-extruder/ring.h"
#include "firmware/arduino-extruder/store.h"
#include "firmware/arduino-extruder/terminal.h"
#include "protocols/extruder_wire.h"

namespace reforge {
namespace firmware {

class Link {
 public:
  Link(Settings& settings, Store& store, Extruder& extruder, const Heater& heater, Output& out,
       uint8_t reset_cause)
      : settings_(settings),
        store_(store),
        extruder_(extruder),
        heater_(heater),
        out_(out),
        terminal_(settings, extruder, out),
        reset_cause_(reset_cause) {}

  void receive(uint8_t byte, uint32_t now_ms);
  void tick(uint32_t now_ms);  // every millisecond, after Extruder::tick

 private:
  void obey(const wire::Frame& frame, uint32_t now_ms);
  void greet(const wire::Hello& hello, uint8_t sequence, uint32_t now_ms);
  void order(const wire::Frame& frame, uint32_t now_ms);
  wire::Reason execute(const wire::Frame& frame, uint32_t now_ms);
  wire::Reason set(const wire::SetSetting& message);
  void answer_again(const wire::Frame& frame);
  void conclude(uint8_t sequence, wire::Reason reason);
  void send_status(uint8_t sequence, uint32_t now_ms);
  bool send(const wire::Frame& frame);
  wire::Banner banner(uint16_t session) const;

  Settings& settings_;
  Store& store_;
  Extruder& extruder_;
  const Heater& heater_;
  Output& out_;
  Terminal terminal_;
  uint8_t reset_cause_;

  wire::Decoder decoder_;
  uint32_t last_byte_ms_ = 0;
  uint32_t last_frame_ms_ = 0;
  uint16_t session_ = 0;  // 0: no hello yet
  bool banner_due_ = true;

  uint8_t last_ = 0;  // sequence of the last order, and what was said to it
  bool any_order_ = false;
  wire::Reason last_ack_ = wire::Reason::kNone;
  wire::Reason last_result_ = wire::Reason::kNone;
  wire::Done last_done_ = {};

  bool pending_ = false;  // an accepted order has not come to its end
  bool saving_ = false;   // ... and it is kSaveSettings
  uint8_t pending_sequence_ = 0;

  bool done_due_ = false;  // did not fit
  uint8_t done_sequence_ = 0;
  wire::Done done_ = {};
  bool report_due_ = false;
  wire::FaultReport report_ = {};
};

}  // namespace firmware
}  // namespace reforge

// A simulated CNC as the virtual rig sees it: bytes and time in, bytes and events out, a few wires.
//
// Three personalities (make_cnc): GrblController, PanelController (Fanuc-like, XON/XOFF) and
// MarlinController. No I/O and no clock. Units: cnc_axes.h.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/rig.h"
#include "tools/rig/cnc_axes.h"

namespace reforge {

// What happened, for the trace.
struct CncEvent {
  enum class Kind {
    kLine,     // text: a line taken for execution; line: its count since power-on
    kMove,     // a queued move has ended at `g54`; value: its speed a second, line
    kSpindle,  // value: rpm, 0 = off, negative = counter-clockwise
    kDwell,    // value: seconds; begins
    kHold,     // text: who asked: "host", "input", "M0", "soft limit", "panel", "door"
    kHeld,     // at rest in Hold
    kResume,
    kHomed,
    kAlarm,  // value: its number
    kReset,
    kEnd,       // M2, M30
    kCustom,    // value: 70..75, done by the CNC's own outputs
    kOverride,  // value: per cent; text: "feed", "rapid" or "spindle"
    kFault,     // text: what the host did wrong
  };
  int64_t ns;
  Kind kind;
  Axes g54;  // the programmed point, in G54, at that time
  double value = 0;
  int64_t line = 0;
  std::string text = {};
};

// The relays behind M70-M75 and the lamp of a running cycle (wired to the extruder board for
// in-stream M-codes).
struct CncOutputs {
  bool open = false, extrude = false, retract = false, running = false;
  bool operator==(const CncOutputs&) const = default;
};

// What an operator does at the machine.
enum class CncButton { kHold, kStart, kReset, kHome, kDoorOpen, kDoorClose };

class CncController {
 public:
  virtual ~CncController() = default;

  virtual void advance_to(int64_t ns) = 0;
  virtual int64_t next_event_ns() const = 0;  // kNeverNs: nothing will happen without bytes
  // Bytes that have arrived by now, real-time commands among them.
  virtual void receive(std::string_view bytes) = 0;
  virtual std::string take_transmitted() = 0;

  virtual void set_hold_input(bool asserted) = 0;
  virtual void set_ready_input(bool ready) = 0;  // the board's: no M-code under way, no fault
  virtual CncOutputs outputs() const = 0;
  virtual void press(CncButton button) = 0;

  virtual std::string state_name() const = 0;
  virtual bool running() const = 0;  // in motion for a program, not held
  virtual const CncAxes& axes() const = 0;
  virtual Axes g54_position() const = 0;  // physical, in G54
  virtual std::vector<CncEvent> take_events() = 0;
};

// The personality a rig file asks for. `homed`: by its operator; otherwise locked until homed.
std::unique_ptr<CncController> make_cnc(const RigDescription& rig, bool homed, bool hold_input);

}  // namespace reforge

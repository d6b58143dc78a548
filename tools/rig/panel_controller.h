// The simulated panel of a Fanuc-like controller in DNC mode: a program dripped over the serial
// line, XON and XOFF, and not a word back.
//
// What it holds its host to
//  - A program stands between two lines of `%`; what is outside is ignored. `O` numbers and `N`
//    numbers are taken, comments stand in parentheses, `;` is no character of the dialect.
//  - DC3 goes out when the receive buffer is three quarters full, DC1 when it is down to a quarter
//    and at power-on and reset. Bytes beyond the buffer are an alarm.
//  - Any word, line or target it does not take is an alarm: it comes to rest, its outputs fall, and
//    the host hears nothing. Only the operator's reset ends it. G4 P is milliseconds.
//  - M70-M75 are its own: relays to the extruder board, done when the board's ready output says so.
//    An S, P or L beside them does not reach the board; only its settings do.
//  - The cycle starts by itself when the tape begins (its operator has chosen DNC and pressed
//    start); after a hold it waits for the operator.
// Limits: as gcode_line.h; no G28, G43, arcs, canned cycles or macros; no even-parity ISO code.
#pragma once

#include <deque>
#include <string>

#include "tools/rig/block_executor.h"

namespace reforge {

class PanelController final : public CncController {
 public:
  explicit PanelController(const RigDescription& rig, bool homed = true, bool hold_input = false);

  void advance_to(int64_t ns) override;
  int64_t next_event_ns() const override;
  void receive(std::string_view bytes) override;
  std::string take_transmitted() override;
  void set_hold_input(bool asserted) override;
  void set_ready_input(bool ready) override;
  CncOutputs outputs() const override;
  void press(CncButton button) override;
  std::string state_name() const override;
  bool running() const override;
  const CncAxes& axes() const override { return executor_.axes(); }
  Axes g54_position() const override { return executor_.g54_position(); }
  std::vector<CncEvent> take_events() override { return executor_.take_events(); }

 private:
  void pump();
  void take_char(char c);
  void begin_line();
  void steer_flow();

  int receive_buffer_bytes_;
  int line_length_max_;
  BlockExecutor executor_;
  bool homed_;
  bool hold_input_;
  bool door_open_ = false;
  int64_t now_ = 0;
  std::deque<char> rx_;
  std::string line_;
  int raw_length_ = 0;
  bool comment_ = false;
  bool reading_ = false;  // between the two %
  bool cycle_ = false;
  bool stopped_ = false;  // DC3 was sent last
  int64_t ready_ns_ = 0;  // a line has been read and is being understood until then
  bool line_read_ = false;
  double feed_ = 0;
  int64_t lines_taken_ = 0;
  std::string tx_;
};

}  // namespace reforge

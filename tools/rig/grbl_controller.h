// The simulated CNC: a five-axis controller of the GRBL family, as strict as a real one. No I/O and
// no clock: time and bytes in, bytes out, next event.
//
// What it holds its host to
//  - A receive buffer of 128 bytes; what does not fit is lost and recorded as a fault.
//  - Lines of at most 80 characters as sent and 79 once blanks and comments are gone (GRBL counts
//    only the latter): longer is error:11.
//  - `ok` when a line is parsed and queued, not when it is executed. With 15 moves queued the next
//    line waits, and what follows it stays in the receive buffer. G4, M3, M5, G10, a change of work
//    offset, M0 and M30 wait until the queue has run dry.
//  - An error does not flush the buffer. In Hold nothing is parsed. Settings and offsets stall the
//    reception for 20 ms: bytes that arrive meanwhile are lost and recorded.
//  - A target outside the travel is ALARM:2 after a controlled stop, and only a reset is heard
//  then;
//    that line is never answered. A reset in motion is ALARM:3: the believed position stays and the
//    axes are carried on by their stopping distance.
//  - M70-M75 are not its own: error:20.
// Details that differ between grbl 1.1 and grblHAL follow grblHAL: `?` is answered while homing and
// in alarm; CR LF counts as two lines as in grbl. The hold input acts on its edge, as GRBL's does.
// Sources: grbl v1.1 "Interface" and "Commands", grblHAL's extensions. Units: cnc_axes.h.
// Overrides: feed 10..200 %, rapids 25, 50, 100 %, spindle 10..200 %, at once, as GRBL's real-time
// bytes 0x90-0x9D; 0x84 or the door's switch is a hold that ends after the door is closed.
// Limits: see gcode_line.h and motion_queue.h; no jogging, probing, check mode or start-up lines,
// no parking and no spindle stop behind an open door; transmission is never held back by a full
// buffer.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/rig.h"
#include "tools/rig/cnc_axes.h"
#include "tools/rig/cnc_controller.h"
#include "tools/rig/gcode_line.h"
#include "tools/rig/motion_queue.h"

namespace reforge {

class GrblController final : public CncController {
 public:
  // Powered on: homed by its operator, or locked until homed; with the hold input as it stands.
  explicit GrblController(const RigDescription& rig, bool homed = true, bool hold_input = false);

  void advance_to(int64_t ns) override;
  int64_t next_event_ns() const override;
  void receive(std::string_view bytes) override;
  std::string take_transmitted() override;
  void set_hold_input(bool asserted) override;
  void set_ready_input(bool) override {}  // it has no M-codes that could wait for it
  CncOutputs outputs() const override { return {false, false, false, running()}; }
  void press(CncButton button) override;

  std::string state_name() const override;  // as in status reports: "Idle", "Hold:0", ...
  bool running() const override;
  const CncAxes& axes() const override { return axes_; }
  Axes position() const;           // machine coordinates, as believed
  Axes physical_position() const;  // where the axes really are
  Axes g54_position() const override;
  int64_t bytes_lost() const { return bytes_lost_; }
  // The most bytes ever held of lines that were not yet answered: what character counting bounds.
  int unanswered_peak() const { return unanswered_peak_; }
  std::vector<CncEvent> take_events() override;

 private:
  enum class Stage { kNone, kParse, kSync, kDwell, kMove, kFlow, kStall, kHome };
  struct Modal {
    int motion = 0;
    bool inches = false;
    bool incremental = false;
    int coordinate_system = 0;
    int spindle = 5;
    bool coolant = false;
    double feed_per_min = 0;
    double rpm = 0;
    int tool = 0;
  };

  // grbl_controller.cpp: the main loop
  void pump();
  bool step();
  void take_char(char c);
  void begin_line();
  int check_against_modal(const GcodeLine& line) const;

  // grbl_execution.cpp: one line
  bool step_sync();
  bool step_dwell();
  bool step_move();
  bool step_flow();
  bool step_home();
  void apply_modal();
  void apply_g10();
  Axes target() const;
  bool within_travel(const Axes& machine) const;
  void answer(int error);
  double spindle_rpm() const;
  void real_time(unsigned char c);
  void hold(const char* who);
  void resume();
  bool override_by(unsigned char c);
  void set_override(int& percent, int to, const char* which);
  void reset();
  void raise_alarm(int number);
  void note_motion();
  bool in_alarm() const { return alarm_ != 0; }
  void event(CncEvent::Kind kind, double value = 0, std::string text = {});
  MotionQueue::Limits motion_limits() const;

  // grbl_reports.cpp: everything that starts with $, and status
  int system_command(std::string_view command);
  int write_setting(std::string_view command);
  void send(const std::string& line);
  void send_banner();
  void report_status();
  void report_settings();
  void report_offsets();
  void report_modes();
  void report_build();
  std::string numbers(const Axes& values) const;
  static std::map<int, double> default_settings(const RigDescription& rig, const CncAxes& axes);

  CncAxes axes_;
  int receive_buffer_bytes_;
  int line_length_max_;
  double min_rpm_, max_rpm_;
  std::map<int, double> settings_;
  MotionQueue motion_;
  std::array<Axes, 6> offsets_{};  // G54 ... G59
  Axes carried_{};                 // physical minus believed position
  Modal modal_;
  Axes parser_position_;  // where the last accepted line ends

  int64_t now_ = 0;
  std::deque<char> rx_;
  std::string line_;
  int raw_length_ = 0;
  bool overflow_ = false;
  enum class Comment { kNone, kParentheses, kToEnd } comment_ = Comment::kNone;
  int unanswered_ = 0;
  int unanswered_peak_ = 0;
  int64_t bytes_lost_ = 0;
  bool losing_ = false;

  Stage stage_ = Stage::kNone;
  GcodeLine pending_;
  int64_t ready_ns_ = 0;        // kParse, kDwell, kStall: when it goes on
  int64_t dwell_left_ns_ = -1;  // -1: not begun
  bool stop_asked_ = false;     // kFlow: M0 has held
  int home_phase_ = 0;

  bool hold_ = false;
  bool held_noted_ = false;
  bool soft_limit_ = false;  // coming to rest before ALARM:2
  bool hold_input_ = false;
  bool door_ = false;       // this hold is a door's
  bool door_open_ = false;  // its switch
  int feed_percent_ = 100, rapid_percent_ = 100, spindle_percent_ = 100;
  int alarm_ = 0;
  bool critical_ = false;  // only a reset is heard
  int64_t lines_taken_ = 0;
  int reports_to_offsets_ = 0;    // status reports until WCO stands in one again
  int reports_to_overrides_ = 1;  // the same of Ov

  std::string tx_;
  std::vector<CncEvent> events_;
};

}  // namespace reforge

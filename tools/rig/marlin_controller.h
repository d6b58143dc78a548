// The simulated CNC of the Marlin family: numbered lines with checksums, ping-pong with a small
// command queue.
//
// What it holds its host to
//  - `N<n> words*<xor>`: a wrong checksum, a number that is not the last plus one, a number without
//    a checksum or the reverse is `Error:…`, `Resend: <n>` and an `ok` that does not count; what
//    waits in the receive buffer is thrown away. Lines without number and checksum are taken.
//  - A line longer than 95 characters is cut silently; bytes beyond the receive buffer are lost.
//  - Four lines wait in the queue; `ok` when one is executed, which for a move means queued. M400
//    answers when motion is over; `echo:busy: processing` every two seconds of waiting.
//  - Targets outside the travel are clamped, as software endstops do. G4 P is milliseconds.
//  - M73 and M75 are progress and timer there, accepted and meaningless; M70, M71, M72 and M74 are
//    unknown: `echo:Unknown command: "…"` and `ok`.
//  - M112 stops dead and is silent until reset.
// A hold input is not Marlin's: the rig's is wired to its feed hold all the same.
// Limits: as gcode_line.h; G4 without S; no M220, no tool changes, no temperatures.
#pragma once

#include <deque>
#include <string>

#include "tools/rig/block_executor.h"

namespace reforge {

class MarlinController final : public CncController {
 public:
  explicit MarlinController(const RigDescription& rig, bool homed = true, bool hold_input = false);

  void advance_to(int64_t ns) override;
  int64_t next_event_ns() const override;
  void receive(std::string_view bytes) override;
  std::string take_transmitted() override;
  void set_hold_input(bool asserted) override;
  void set_ready_input(bool) override {}
  CncOutputs outputs() const override { return {false, false, false, running()}; }
  void press(CncButton button) override;
  std::string state_name() const override;
  bool running() const override;
  const CncAxes& axes() const override { return executor_.axes(); }
  Axes g54_position() const override { return executor_.g54_position(); }
  std::vector<CncEvent> take_events() override { return executor_.take_events(); }

 private:
  void pump();
  void take_line();
  void refuse(const char* why);
  void begin_command();
  bool host_command(const std::string& words);
  void unknown(const std::string& words);
  void send(const std::string& line) { tx_ += line + "\n"; }
  void restart();

  int receive_buffer_bytes_;
  size_t line_length_max_;
  BlockExecutor executor_;
  bool hold_input_;
  int64_t now_ = 0;
  std::deque<char> rx_;
  bool losing_ = false;
  std::string line_;
  std::deque<std::string> queue_;
  int64_t last_line_ = 0;
  bool executing_ = false;  // an ok is owed
  bool draining_ = false;   // for M400
  int64_t ready_ns_ = 0;    // the command at the front is being parsed until then
  int64_t busy_ns_ = 0;     // when to say busy next
  bool killed_ = false;
  int64_t lines_taken_ = 0;
  std::string tx_;
};

}  // namespace reforge

// A CNC of the GRBL family in process, for `"backend": "simulated"` and dry runs. No I/O and no
// clock: time and bytes in, bytes out, next event; the same bytes at the same times give the same
// answers, bit for bit.
//
// It keeps what the streamer relies on: a bounded receive buffer, `ok` for parsed and queued, a
// queue of 16 moves, dwells and spindle changes that wait for the queue, hold and resume, a reset
// with a banner, ALARM:3 for a reset in motion. It reads with protocols/gcode, the reader of
// verifier and streamer.
// Limits: constant speed between points (no acceleration), no travel limits, no homing; the strict
// judge of a program's bytes is the virtual rig (tools/rig), which shares no code with us.
#pragma once

#include <array>
#include <deque>
#include <optional>
#include <string>
#include <string_view>

#include "controller/core/instant.h"
#include "protocols/gcode/modal.h"
#include "protocols/rig.h"

namespace reforge {

class SimulatedCnc {
 public:
  explicit SimulatedCnc(const RigDescription& rig);

  void receive(Instant now, std::string_view bytes);
  void advance(Instant now);
  Instant next_event() const;
  std::string take_transmitted();

  int bytes_lost() const { return bytes_lost_; }  // beyond the receive buffer

 private:
  using Position = std::array<double, gcode::kAxes>;  // mm, degrees; G54
  struct Piece {  // of the queue: a move, or a pause where it stands
    Position to;
    Duration lasts;
  };

  void real_time(char byte);
  void parse();                        // lines, as long as the queue takes them
  bool obey(const std::string& line);  // false: it has to wait, and is asked again
  bool execute(const std::string& line);
  void enqueue(const gcode::ModalState& before, const gcode::Action& action);
  void report_status();
  void reset();
  void say(std::string_view text);

  RigDescription rig_;
  gcode::Dialect dialect_;
  gcode::ModalState modal_;
  gcode::Line line_;
  Instant now_{};
  std::string received_;
  std::string output_;
  std::deque<Piece> queue_;
  Position at_{};                      // where the last finished piece has ended
  std::optional<Instant> piece_ends_;  // of the piece under way
  Duration piece_left_{};              // of it, while held
  bool held_ = false;
  bool alarm_ = false;
  int bytes_lost_ = 0;
};

}  // namespace reforge

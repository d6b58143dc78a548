// Hands program lines to the CNC: as many as its receiver holds, never one more.
//
// Invariants: unacknowledged bytes <= window (character counting: every byte of a line counts until
// its acknowledgement); no line above the durable horizon is handed over; lines go in the program's
// order, each once; nothing goes while a barrier is ahead. Blank and comment lines are not sent but
// keep their numbers, and count as acknowledged with the line before them.
// The horizon is asked for ahead of need (`horizon_ahead` lines, at half of it), so that no line
// waits for the disk. A doubled acknowledgement makes the count too small by a line until it is
// found at the next drain (one is left over); a lost one only makes it too large. Limits: the
// character-counting and line-window flows; XON/XOFF comes with the drip dialect.
#pragma once

#include <deque>
#include <optional>
#include <string>

#include "controller/core/job.h"
#include "controller/core/program_line.h"
#include "controller/devices/cnc_device.h"

namespace reforge {

struct StreamerOptions {
  LineNumber horizon_ahead = 200;
  LineNumber first_line = 1;  // lines before it are done
  // A "; path" line so many lines behind the last drain is a checkpoint: drained, so that a crash
  // costs no more than that.
  LineNumber checkpoint_every = 500;
  bool relay = true;  // M70-M75 are barriers; false: passed on to a CNC that runs them
};

class Streamer {
 public:
  Streamer(std::shared_ptr<ProgramSource> program, const CncDevice& device,
           const RigDescription& rig, StreamerOptions options);

  // Narrows the window to what the controller said of itself. Before the first line.
  void limit_window(int bytes);

  // The next bytes for the wire; empty when the window is full, the horizon near, or a barrier or
  // the end is next. An error: the program cannot be read, or line N may not be sent.
  Result<std::string> pump();

  // Hands over the drain's dwell behind everything sent; false when the window has no room yet.
  bool pump_drain(std::string& bytes);

  // An `ok` or `error`. Unexpected: nothing was outstanding.
  enum class Settled : std::uint8_t { kLine, kDrain, kUnexpected };
  Settled settle();
  // The line the next acknowledgement belongs to, the drain's dwell apart; 0: none outstanding.
  LineNumber next_unacknowledged() const;

  // A checkpoint stands next: to be drained and passed, nothing is relayed.
  bool checkpoint_ahead() const;
  void pass_checkpoint();

  // An M-code stands next: every line before it has been handed over and it lies within the
  // horizon. When all is drained: begin_barrier, relay, pass_barrier.
  bool barrier_ahead() const;
  const ExtruderOrder& barrier_order() const { return barrier_->order; }
  LineNumber next_line() const { return next_; }
  void begin_barrier();
  void pass_barrier();
  bool at_end() const;  // every line handed over

  // Everything acknowledged so far is certainly executed (drained).
  void mark_executed();

  void horizon_durable(LineNumber line);
  // The horizon that should be asked for now, if any; each is returned once.
  std::optional<LineNumber> wanted_horizon();

  const LineCertainty& certainty() const { return certainty_; }
  int unacknowledged_bytes() const { return in_flight_bytes_; }
  bool all_acknowledged() const { return in_flight_.empty(); }
  double dwell_in_flight_s() const { return dwell_in_flight_s_; }
  int window() const { return window_; }

 private:
  struct InFlight {
    LineNumber line;  // 0: the drain's dwell
    int bytes;
    double dwell_s;
  };

  Status look_ahead();  // reads lines until words or a barrier stand next
  bool has_room(int bytes) const;
  void push(InFlight sent);

  std::shared_ptr<ProgramSource> program_;
  const CncDevice& device_;
  ProgramLineReader reader_;
  StreamerOptions options_;
  int window_;
  bool counts_bytes_;

  LineNumber next_ = 1;                 // the first line not yet handed over
  std::optional<std::string> encoded_;  // line next_, ready for the wire
  double encoded_dwell_s_ = 0;
  std::optional<ProgramLine> barrier_;
  bool checkpoint_ = false;  // line next_ is one
  std::deque<InFlight> in_flight_;
  int in_flight_bytes_ = 0;
  double dwell_in_flight_s_ = 0;
  LineNumber horizon_asked_ = 0;
  LineCertainty certainty_;
};

}  // namespace reforge

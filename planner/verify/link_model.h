// Whether the serial link can carry the lines as fast as the machine uses them up.
//
// The controller holds what its receive buffer and its motion queue hold; segments that are shorter
// in time than their lines are on the wire use that reserve up, and at its end the machine stands
// still in mid-path: a mark on the part, a blob on a bead. Lines are sent compact
// (protocols/gcode/line.h) with one byte for the end of line, ten bits a byte, as long as the
// receive buffer has room; a line leaves the buffer when the queue of 15 motions has a free place.
// Seconds, on a clock that begins with each barrier (where the machine stands still anyway).
// Limits: what host and controller need to think is not counted.
#pragma once

#include <cstddef>
#include <deque>

#include "protocols/gcode/line.h"
#include "protocols/rig.h"

namespace reforge::verify {

// Bytes on the wire, the end of line included.
std::size_t bytes_sent(const gcode::Line& line);

class LinkModel {
 public:
  explicit LinkModel(const CncLink& link);

  // The next segment of a path: the bytes of its line (and of lines without motion before it), and
  // how long the motion takes. Returns how long the machine waited for it in mid-path.
  double segment(std::size_t bytes, double seconds);
  void barrier();

 private:
  struct Held {
    double until;  // when the line leaves the receive buffer
    std::size_t bytes;
  };
  double bytes_per_s_;
  std::size_t buffer_bytes_;
  double sent_ = 0;    // when the last line had arrived
  double taken_ = 0;   // when the last line came into the motion queue
  double moved_ = 0;   // when the last motion ends
  bool first_ = true;  // nothing moves yet
  std::deque<Held> in_buffer_;
  std::size_t buffered_ = 0;   // bytes
  std::deque<double> queued_;  // ends of the motions in the queue
};

}  // namespace reforge::verify

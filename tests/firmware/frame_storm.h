// Frames of every kind and damage thrown at the firmware's logic, with a judge that looks every
// millisecond: whatever is sent, outputs are safe and counts agree.
#pragma once

#include <cstdint>
#include <string>

namespace reforge {

struct FrameOutcome {
  int64_t frames = 0;
  int64_t valid = 0;  // whole, with a right CRC
  int64_t taken = 0;  // orders the board acknowledged
  int64_t wrong = 0;
  std::string first;  // what was wrong first
};

FrameOutcome run_frame_storm(int64_t frames, uint64_t seed);

}  // namespace reforge

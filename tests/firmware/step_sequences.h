// Random sequences of M72-M75 on an open, hot board: steps commanded are steps made, to the step.
//
// A sequence is one to four orders and ends at rest. Judged after each: the pin's count is the
// board's; a retraction has exactly the length asked for; M72 restores exactly that; a counted
// extrusion (on the host, where text mode's M72 with a length can be called) has exactly its
// length; a timed one is rate times time within what the order's and the ramps' milliseconds allow.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "protocols/extruder_wire.h"

namespace reforge {

class SteppedBoard {
 public:
  virtual ~SteppedBoard() = default;
  // Gives an order and waits for its end; false if it was refused. M72 returns when extrusion
  // begins.
  virtual bool order(uint8_t m_code, int32_t argument) = 0;
  // M72 with a length, to its end; false where the board takes none from a host.
  virtual bool extrude_length(int32_t um, int32_t um_per_s) = 0;
  virtual void run_ms(int64_t ms) = 0;
  virtual int64_t pin() const = 0;
  virtual int64_t reported() = 0;
};

std::unique_ptr<SteppedBoard> stepped_logic();
std::unique_ptr<SteppedBoard> stepped_avr(const std::filesystem::path& elf);

struct SequenceOutcome {
  int64_t wrong = 0;
  int64_t orders = 0;
  int64_t steps = 0;
  std::string first;
};

SequenceOutcome run_step_sequences(SteppedBoard& board, int64_t count, uint64_t seed);

}  // namespace reforge

// The daemon's end of the extruder link and the firmware, with a faulty wire between them and
// mishaps around them: one seeded script each, judged every millisecond.
//
// The firmware is either its logic compiled for the host (fast) or the ELF in simavr (the real
// thing). Judged: outputs are safe within their deadlines, filament is never pushed without an
// order, steps counted on the pin are the steps the board reports, and when the wire is sound again
// host and board agree.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "protocols/rig.h"
#include "tools/rig/extruder_board.h"

namespace reforge {

// A board as this world sees it; milliseconds since it was made.
class TriedBoard {
 public:
  virtual ~TriedBoard() = default;
  virtual void advance_1ms() = 0;
  virtual void receive(std::string_view bytes) = 0;
  virtual std::string take_bytes() = 0;
  virtual void suffer(BoardMishap mishap) = 0;
  virtual int64_t position() const = 0;  // steps on the pin
  virtual int64_t position_since_reset() const = 0;
  virtual bool may_heat() = 0;  // the heater was on in this millisecond
  virtual bool module_open() const = 0;
  virtual bool run_permitted() const = 0;
};

std::unique_ptr<TriedBoard> logic_board();
std::unique_ptr<TriedBoard> avr_board(const std::filesystem::path& elf);

struct ScriptOutcome {
  std::optional<std::string> wrong;  // the first thing that was; with its millisecond
  int64_t faults = 0;                // spoiled bytes and mishaps
  int64_t orders = 0;
  int64_t steps = 0;
  int64_t virtual_ms = 0;
};

ScriptOutcome run_fault_script(TriedBoard& board, const RigDescription& rig, uint64_t seed);

}  // namespace reforge

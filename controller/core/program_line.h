// What one line of a program means to the stream: nothing, words for the CNC, or a barrier.
//
// Reads with protocols/gcode, the verifier's reader too, so that both take the same text for the
// same program; comments and blanks are taken out, an M70-M75 stands alone on its line. On top of
// the reader stand the orders the extruder must never get: M72 before M70, M72 and M74 together.
// Source: FORMATS.md, "program.nc".
#pragma once

#include <string>
#include <string_view>

#include "controller/core/program.h"
#include "controller/devices/extruder_order.h"
#include "protocols/gcode/modal.h"
#include "protocols/result.h"
#include "protocols/rig.h"

namespace reforge {

struct ProgramLine {
  enum class Kind : std::uint8_t { kNothing, kWords, kBarrier };
  Kind kind = Kind::kNothing;
  std::string words;        // what goes on the wire (a barrier's too, for the in-stream route)
  ExtruderOrder order{};    // kBarrier: absent arguments are the rig's values
  bool checkpoint = false;  // kNothing: a "; path" or "; block" line
  double dwell_s = 0;       // of a G4 on this line: the CNC may be idle so long
};

// Reads the lines of one program in order.
class ProgramLineReader {
 public:
  explicit ProgramLineReader(const RigDescription& rig);
  Result<ProgramLine> read(std::string_view text, LineNumber number);

 private:
  Result<ExtruderOrder> order_of(const gcode::Action& action, const gcode::ModalState& before,
                                 LineNumber number) const;

  Extrusion extrusion_;
  gcode::Dialect dialect_;
  gcode::ModalState modal_;
  gcode::Line line_;  // kept to save its allocations
};

// The header's "; g54: X.. Y.. Z.." in mm, from the comment lines before the first words.
Result<Point<MachineFrame>> g54_of_header(ProgramSource& program, const RigDescription& rig);

}  // namespace reforge

// What one line of a program means to the stream: nothing, words for the CNC, or a barrier.
//
// The words keep their text; only comments, blanks and bytes no controller wants are taken out. An
// M70-M75 must stand alone on its line with its own argument; anything else is a fault of the
// program. Source: FORMATS.md, "program.nc".
#pragma once

#include <string>
#include <string_view>

#include "controller/core/program.h"
#include "controller/devices/extruder_link.h"
#include "protocols/result.h"
#include "protocols/rig.h"

namespace reforge {

struct ProgramLine {
  enum class Kind : std::uint8_t { kNothing, kWords, kBarrier };
  Kind kind = Kind::kNothing;
  std::string words;      // kWords (and kBarrier, for the in-stream route): what goes on the wire
  ExtruderOrder order{};  // kBarrier: absent arguments are the rig's values
  double dwell_s = 0;     // of a G4 on this line: the CNC may be idle so long
};

Result<ProgramLine> classify(std::string_view text, const Extrusion& extrusion);

// The header's "; g54: X.. Y.. Z.." in mm, from the comment lines before the first words.
Result<Point<MachineFrame>> g54_of_header(ProgramSource& program);

}  // namespace reforge

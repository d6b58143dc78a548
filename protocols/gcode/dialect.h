// What one family of CNC controllers takes as program text. Data only; line.h and modal.h obey it.
//
// Words that a controller would take but that nobody here has given a meaning to are not in a
// dialect: the reader refuses them. Limits now: no arcs, canned cycles, tool changes, macros or
// rotated frames in any dialect.
#pragma once

#include <cstddef>
#include <string_view>

#include "protocols/rig.h"

namespace reforge::gcode {

struct Dialect {
  std::string_view name;
  std::size_t line_length_max;  // characters, comments included, without the end of line
  bool semicolon_comments;      // from ';' to the end of the line
  bool parenthesis_comments;    // '(' … ')', not nested
  bool percent_lines;           // a line that holds '%' alone begins and ends the tape
  bool program_numbers;         // O1234
  bool line_numbers;            // N1234 before the other words
  double dwell_seconds_per_p;   // G4 P in seconds: 1; in milliseconds: 0.001
  std::string_view axes;        // the axis letters, e.g. "XYZBC"
};

// The dialect of a rig: its controller, its line length and its axes.
Dialect dialect_of(const CncLink& link, RotaryTable table);
Dialect dialect_of(CncDialect family, std::size_t line_length_max, RotaryTable table);

}  // namespace reforge::gcode

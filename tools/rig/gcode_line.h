// One line of G-code as the simulated GRBL reads it: words, checks and GRBL's own error numbers.
//
// Deliberately independent of protocols/gcode: the virtual rig judges what the daemon sends. Takes
// the line as GRBL's line buffer holds it: upper case, no blanks, no comments. Values are as
// written; inches, distance mode and offsets are applied by the controller, which holds the modal
// state. Error numbers: grbl v1.1 "Interface". Limits: no arcs, probing, G28/G30/G92, G43, G93, M7:
// error 20, though GRBL knows some of them.
#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "tools/rig/cnc_axes.h"

namespace reforge {

struct GcodeLine {
  enum class NonModal { kNone, kDwell, kSetCoordinates, kMachineCoordinates };  // G4 G10 G53
  enum class Flow { kNone, kPause, kEnd };                                      // M0, M2 or M30

  std::optional<int> motion;  // 0, 1 or 80
  NonModal non_modal = NonModal::kNone;
  std::optional<bool> inches;            // G20, G21
  std::optional<bool> incremental;       // G91, G90
  std::optional<int> coordinate_system;  // 0 = G54 ... 5 = G59
  std::optional<int> spindle;            // 3, 4 or 5
  std::optional<bool> coolant;           // M8, M9
  std::optional<int> custom;             // M70 ... M75, where the controller knows them
  Flow flow = Flow::kNone;
  std::optional<double> f, s, p, t;
  std::optional<int> l;
  std::optional<int64_t> n;
  std::array<std::optional<double>, kAxisCount> axis;

  bool has_axes() const;
};

struct GcodeReading {
  int error = 0;  // GRBL's number; 0 = the line is sound by itself
  GcodeLine line;
};

// `letters` names the five axes in order, as CncAxes::letters. `custom`: M70-M75 have a meaning; an
// S, P or L beside them is theirs.
GcodeReading read_gcode(std::string_view text, std::string_view letters, bool custom = false);

namespace grbl_error {
constexpr int kExpectedLetter = 1;
constexpr int kBadNumber = 2;
constexpr int kInvalidStatement = 3;
constexpr int kNegative = 4;
constexpr int kNotIdle = 8;
constexpr int kLocked = 9;
constexpr int kLineOverflow = 11;
constexpr int kUnsupported = 20;
constexpr int kModalGroup = 21;
constexpr int kFeedUndefined = 22;
constexpr int kNotInteger = 23;
constexpr int kAxisConflict = 24;
constexpr int kRepeated = 25;
constexpr int kNoAxisWords = 26;
constexpr int kLineNumber = 27;
constexpr int kValueMissing = 28;
constexpr int kCoordinateSystem = 29;
constexpr int kG53Mode = 30;
constexpr int kAxisWordsUnused = 31;
constexpr int kUnused = 36;
}  // namespace grbl_error

}  // namespace reforge

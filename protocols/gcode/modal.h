// What a line of words does: the modal state of a program and the one action each line asks for.
//
// One interpreter for verifier and streamer. Strict: a word without a meaning here, two codes of
// one modal group, a word nobody uses, a missing argument, motion without a feed, anything after
// the end of the program: errors with line and column, never skipped. Physical rules (limits,
// collisions, M72 before M70) are not the reader's: the verifier judges them.
//
// Units: millimetres, degrees, mm/min, rev/min, seconds; G20 is converted on reading. Rotary words
// are degrees always. Rules of the reader that controllers leave open:
//   * M70-M75, G4 and the program's end stand alone on their line (with their arguments).
//   * Unless G20/G21 and G90/G91 were said, an axis word is refused: nothing depends on what a
//     controller was left in. (G94, G17 and G54 are every controller's start state.)
//   * G0/G1 are modal: a line of axis words alone repeats the last motion.
//   * a relative move of an axis whose place was never said is refused.
#pragma once

#include <array>
#include <optional>

#include "protocols/gcode/line.h"

namespace reforge::gcode {

enum class Axis { kX, kY, kZ, kTilt, kC };
constexpr std::size_t kAxes = 5;

enum class Motion { kUnset, kRapid, kFeed };
enum class LengthUnit { kUnset, kMillimetre, kInch };
enum class Distance { kUnset, kAbsolute, kRelative };
enum class Spindle { kOff, kClockwise, kCounterclockwise };

struct ModalState {
  Motion motion = Motion::kUnset;
  LengthUnit unit = LengthUnit::kUnset;
  Distance distance = Distance::kUnset;
  int wcs = 54;  // G54 … G59
  std::optional<double> feed_mm_per_min;
  std::optional<double> spindle_rpm;  // the last S
  Spindle spindle = Spindle::kOff;
  bool coolant = false;
  std::array<std::optional<double>, kAxes>
      position;  // programmed: mm, degrees; empty: not yet said
  // M70-M75 as commanded; the extruder starts closed.
  bool module_open = false;
  bool extruding = false;
  bool retracting = false;
  std::optional<double> temperature_c;      // M70 S
  std::optional<double> filament_mm_per_s;  // M72 P; empty: the rig's
  std::optional<double> retract_mm;         // M74 P; empty: the rig's
  bool ended = false;

  const std::optional<double>& at(Axis axis) const {
    return position[static_cast<std::size_t>(axis)];
  }
};

struct Action {
  enum class Kind {
    kNothing,  // blank, comment, tape mark, or modal words only
    kMove,     // ModalState::motion says which; `moved` which axes were named
    kDwell,    // dwell_s
    kModule,   // M70 … M75: module_code
    kEnd,      // M2, M30
  };
  Kind kind = Kind::kNothing;
  std::array<bool, kAxes> moved{};  // axes named on the line
  double dwell_s = 0;
  int module_code = 0;             // 70 … 75
  std::optional<double> argument;  // S of M70, P of M72 and M74
  bool spindle_changed = false;    // M3, M4, M5, or S while it turns
};

// Applies the line to the state. On an error the state is as before.
Result<Action> apply(const Line& line, const Dialect& dialect, ModalState& state);

}  // namespace reforge::gcode

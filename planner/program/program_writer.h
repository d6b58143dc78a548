// Program text in one controller's dialect: modal words, comments, line length.
//
// Purpose: the only place that knows how a line is spelt; post.h decides what is said. Words that
// repeat the modal state are left out; a move to where the machine stands writes nothing. Units
// here: mm, degrees, mm/s (written as mm/min), seconds. Format: FORMATS.md, "program.nc". Limits:
// G4 P is seconds for GRBL, milliseconds for Marlin and Fanuc-like controllers.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "protocols/rig.h"

namespace reforge {

class ProgramWriter {
 public:
  ProgramWriter(const CncLink& link, RotaryTable table);

  void begin();  // tape mark and program number where the dialect has them
  void end();    // M30
  // `; key: value`; a value too long for the line goes on in `; +rest`.
  void header(const std::string& key, const std::string& value);
  void comment(const std::string& text);

  // Words said as they are, on a line of their own: "M3 S12000".
  void words(const std::string& text);
  void dwell(double seconds);
  // An M-code of the extruder with its argument, e.g. M72 P0.3466.
  void module_code(int code, char letter = 0, double value = 0, int decimals = 4);

  void rapid(const Point<MachineFrame>& to);
  void feed(const Point<MachineFrame>& to, double feed_mm_per_s);
  void rapid_z(double z);
  void rapid_xy(double x, double y);
  void turn(double tilt_deg, double c_deg);

  std::size_t lines() const { return lines_; }
  std::string take() { return std::move(text_); }

 private:
  void line(const std::string& text);
  // " X1.5" when it differs from what the axis stands at, else "".
  std::string axis(int index, double value);
  void motion(int code, const std::string& axes, const std::string& feed);

  CncLink link_;
  char tilt_letter_;
  std::string text_;
  std::size_t lines_ = 0;
  int motion_ = -1;                // modal G0 / G1
  std::array<std::string, 5> at_;  // as written: X Y Z tilt C
  std::string feed_;
};

// At most `decimals` decimals, without trailing zeros and without "-0".
std::string number(double value, int decimals);

}  // namespace reforge

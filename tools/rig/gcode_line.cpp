#include "tools/rig/gcode_line.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>

namespace reforge {
namespace {

using namespace grbl_error;

// A sign, digits and a point; no exponent.
std::optional<double> take_number(std::string_view& text) {
  size_t n = 0;
  if (n < text.size() && (text[n] == '+' || text[n] == '-')) ++n;
  size_t digits = 0;
  bool point = false;
  for (; n < text.size(); ++n) {
    if (text[n] == '.' && !point) {
      point = true;
    } else if (text[n] >= '0' && text[n] <= '9') {
      ++digits;
    } else {
      break;
    }
  }
  if (digits == 0) return std::nullopt;
  const char* begin = text.data() + (text[0] == '+' ? 1 : 0);
  double value = 0;
  std::from_chars(begin, text.data() + n, value);
  text.remove_prefix(n);
  return value;
}

// The modal groups of RS274/NGC that this controller knows.
enum Group : unsigned {
  kNonModalGroup = 1u << 0,
  kMotionGroup = 1u << 1,
  kPlaneGroup = 1u << 2,
  kDistanceGroup = 1u << 3,
  kFeedModeGroup = 1u << 4,
  kUnitsGroup = 1u << 5,
  kCutterGroup = 1u << 6,
  kLengthGroup = 1u << 7,
  kSystemGroup = 1u << 8,
  kPathGroup = 1u << 9,
  kFlowGroup = 1u << 10,
  kSpindleGroup = 1u << 11,
  kCoolantGroup = 1u << 12,
  kCustomGroup = 1u << 13,
};

// Enters a G word; returns its group, 0 if unknown.
unsigned enter_g(int code, GcodeLine& line) {
  using NonModal = GcodeLine::NonModal;
  switch (code) {
    case 0:
    case 1:
    case 80:
      return line.motion = code, kMotionGroup;
    case 4:
      return line.non_modal = NonModal::kDwell, kNonModalGroup;
    case 10:
      return line.non_modal = NonModal::kSetCoordinates, kNonModalGroup;
    case 53:
      return line.non_modal = NonModal::kMachineCoordinates, kNonModalGroup;
    case 17:
      return kPlaneGroup;
    case 20:
    case 21:
      return line.inches = code == 20, kUnitsGroup;
    case 40:
      return kCutterGroup;
    case 49:
      return kLengthGroup;
    case 54:
    case 55:
    case 56:
    case 57:
    case 58:
    case 59:
      return line.coordinate_system = code - 54, kSystemGroup;
    case 61:
      return kPathGroup;
    case 90:
    case 91:
      return line.incremental = code == 91, kDistanceGroup;
    case 94:
      return kFeedModeGroup;
    default:
      return 0;
  }
}

unsigned enter_m(int code, GcodeLine& line) {
  switch (code) {
    case 0:
      return line.flow = GcodeLine::Flow::kPause, kFlowGroup;
    case 1:
      return kFlowGroup;  // optional stop: no switch, ignored
    case 2:
    case 30:
      return line.flow = GcodeLine::Flow::kEnd, kFlowGroup;
    case 3:
    case 4:
    case 5:
      return line.spindle = code, kSpindleGroup;
    case 8:
    case 9:
      return line.coolant = code == 8, kCoolantGroup;
    default:
      return 0;
  }
}

int enter_code(char letter, double value, bool custom, GcodeLine& line, unsigned& groups) {
  if (value < 0 || value > 999) return kUnsupported;
  const int code = static_cast<int>(value);
  if (value != code) return letter == 'M' ? kNotInteger : kUnsupported;
  unsigned group = 0;
  if (custom && letter == 'M' && code >= 70 && code <= 75) {
    line.custom = code;
    group = kCustomGroup;
  } else {
    group = letter == 'G' ? enter_g(code, line) : enter_m(code, line);
  }
  if (group == 0) return kUnsupported;
  if (groups & group) return kModalGroup;
  groups |= group;
  return 0;
}

int enter_value(char letter, double value, std::string_view letters, GcodeLine& line) {
  const auto once = [&](auto& slot, auto v) {
    if (slot) return kRepeated;
    slot = v;
    return 0;
  };
  const size_t axis = letters.find(letter);
  if (axis != std::string_view::npos) return once(line.axis[axis], value);
  if (letter != 'L' && value < 0) return kNegative;
  switch (letter) {
    case 'F':
      return once(line.f, value);
    case 'S':
      return once(line.s, value);
    case 'P':
      return once(line.p, value);
    case 'T':
      return value == std::floor(value) ? once(line.t, value) : kNotInteger;
    case 'L':
      return value == std::floor(value) ? once(line.l, static_cast<int>(value)) : kNotInteger;
    case 'N':
      if (value < 1 || value > 9999999 || value != std::floor(value)) return kLineNumber;
      return once(line.n, static_cast<int64_t>(value));
    default:
      return kUnsupported;
  }
}

// Words that need each other, or that nobody uses.
int check(const GcodeLine& line) {
  using NonModal = GcodeLine::NonModal;
  const bool moves = line.motion && *line.motion != 80;
  if (line.non_modal == NonModal::kSetCoordinates) {
    if (moves) return kAxisConflict;
    if (!line.has_axes()) return kNoAxisWords;
    if (!line.p || !line.l) return kValueMissing;
    if (*line.l != 2 && *line.l != 20) return kUnsupported;
    if (*line.p != std::floor(*line.p)) return kNotInteger;
    if (*line.p > 6) return kCoordinateSystem;
    return 0;
  }
  if (line.custom) return line.has_axes() || moves ? kAxisConflict : 0;
  if (line.l) return kUnused;
  if (line.non_modal == NonModal::kDwell) {
    if (!line.p) return kValueMissing;
  } else if (line.p) {
    return kUnused;
  }
  if (line.motion == 80 && line.has_axes()) return kAxisWordsUnused;
  return 0;
}

}  // namespace

bool GcodeLine::has_axes() const {
  return std::any_of(axis.begin(), axis.end(), [](const auto& word) { return word.has_value(); });
}

GcodeReading read_gcode(std::string_view text, std::string_view letters, bool custom) {
  GcodeReading reading;
  unsigned groups = 0;
  while (!text.empty()) {
    const char letter = text.front();
    if (letter < 'A' || letter > 'Z') return {kExpectedLetter, {}};
    text.remove_prefix(1);
    const std::optional<double> value = take_number(text);
    if (!value) return {kBadNumber, {}};
    const int error = letter == 'G' || letter == 'M'
                          ? enter_code(letter, *value, custom, reading.line, groups)
                          : enter_value(letter, *value, letters, reading.line);
    if (error) return {error, {}};
  }
  reading.error = check(reading.line);
  return reading;
}

}  // namespace reforge

#include "protocols/gcode/modal.h"

#include <cmath>
#include <string>

namespace reforge::gcode {
namespace {

// What a line names, before any of it takes effect.
struct Request {
  const Word* motion = nullptr;
  const Word* dwell = nullptr;
  const Word* unit = nullptr;
  const Word* distance = nullptr;
  const Word* plane = nullptr;
  const Word* feed_mode = nullptr;
  const Word* wcs = nullptr;
  const Word* cancel_radius = nullptr;
  const Word* cancel_length = nullptr;
  const Word* cancel_cycle = nullptr;
  const Word* path_control = nullptr;
  const Word* spindle = nullptr;
  const Word* coolant = nullptr;
  const Word* module = nullptr;
  const Word* end = nullptr;
  const Word* f = nullptr;
  const Word* s = nullptr;
  const Word* p = nullptr;
  std::array<const Word*, kAxes> axes{};
  int words = 0;  // without line and program numbers
};

std::string name(const Word& word) {
  // Codes have at most one decimal; anything else is shown as written, to three.
  std::string digits = std::to_string(std::llround(word.value * 1000.0));
  const bool negative = digits.front() == '-';
  if (negative) digits.erase(0, 1);
  while (digits.size() < 4) digits.insert(0, 1, '0');
  std::string text = digits.substr(0, digits.size() - 3) + "." + digits.substr(digits.size() - 3);
  while (text.back() == '0') text.pop_back();
  if (text.back() == '.') text.pop_back();
  return std::string(1, word.letter) + (negative ? "-" : "") + text;
}

Error fault(const Line& line, const Word& word, const std::string& sentence) {
  return {Code::kMalformed, "line " + std::to_string(line.number) + ", column " +
                                std::to_string(word.column) + ": " + sentence};
}

// The code in tenths, or -1 when the number cannot be a code.
int tenths(double value) {
  if (!(value >= 0 && value < 1000)) return -1;
  const double scaled = value * 10.0;
  const double whole = std::round(scaled);
  return std::fabs(scaled - whole) < 1e-6 ? static_cast<int>(whole) : -1;
}

const Word** slot_of_g(int code, Request& r) {
  switch (code) {
    case 0:
    case 10:
      return &r.motion;
    case 40:
      return &r.dwell;
    case 170:
      return &r.plane;
    case 200:
    case 210:
      return &r.unit;
    case 400:
      return &r.cancel_radius;
    case 490:
      return &r.cancel_length;
    case 540:
    case 550:
    case 560:
    case 570:
    case 580:
    case 590:
      return &r.wcs;
    case 610:
    case 640:
      return &r.path_control;
    case 800:
      return &r.cancel_cycle;
    case 900:
    case 910:
      return &r.distance;
    case 940:
      return &r.feed_mode;
    default:
      return nullptr;
  }
}

const Word** slot_of_m(int code, Request& r) {
  switch (code) {
    case 20:
    case 300:
      return &r.end;
    case 30:
    case 40:
    case 50:
      return &r.spindle;
    case 70:
    case 80:
    case 90:
      return &r.coolant;
    case 700:
    case 710:
    case 720:
    case 730:
    case 740:
    case 750:
      return &r.module;
    default:
      return nullptr;
  }
}

Status collect(const Line& line, const Dialect& dialect, Request& r) {
  for (const Word& word : line) {
    const bool first = &word == line.begin();
    if (word.letter == 'N' || word.letter == 'O') {
      const bool allowed = word.letter == 'N' ? dialect.line_numbers : dialect.program_numbers;
      if (!allowed || !first || word.value < 0 || word.value != std::floor(word.value)) {
        return fault(line, word,
                     name(word) + " is no line or program number this dialect takes here");
      }
      continue;
    }
    ++r.words;
    const Word** slot = nullptr;
    if (word.letter == 'G' || word.letter == 'M') {
      const int code = tenths(word.value);
      slot = word.letter == 'G' ? slot_of_g(code, r) : slot_of_m(code, r);
      if (!slot) return fault(line, word, name(word) + " is not a code this reader understands");
      if (*slot) {
        return fault(line, word,
                     name(**slot) + " and " + name(word) + " exclude each other on a line");
      }
    } else if (const std::size_t axis = dialect.axes.find(word.letter);
               axis != std::string_view::npos) {
      slot = &r.axes[axis];
    } else if (word.letter == 'F') {
      slot = &r.f;
    } else if (word.letter == 'S') {
      slot = &r.s;
    } else if (word.letter == 'P') {
      slot = &r.p;
    } else {
      return fault(line, word,
                   std::string("the word ") + word.letter + " has no meaning here; expected " +
                       "G, M, F, S, P or an axis of " + std::string(dialect.axes));
    }
    if (*slot) return fault(line, word, std::string("the word ") + word.letter + " stands twice");
    *slot = &word;
  }
  return Unit{};
}

bool any_axis(const Request& r) {
  for (const Word* w : r.axes) {
    if (w) return true;
  }
  return false;
}

Result<Action> apply_dwell(const Line& line, const Request& r, const Dialect& dialect) {
  if (!r.p) return fault(line, *r.dwell, "G4 needs P, the time to wait");
  if (r.words != 2) return fault(line, *r.dwell, "G4 P stands alone on its line");
  if (r.p->value < 0) return fault(line, *r.p, "a dwell cannot be negative");
  Action action;
  action.kind = Action::Kind::kDwell;
  action.dwell_s = r.p->value * dialect.dwell_seconds_per_p;
  return action;
}

Result<Action> apply_module(const Line& line, const Request& r, ModalState& state) {
  const int code = tenths(r.module->value) / 10;
  const Word* argument = code == 70 ? r.s : (code == 72 || code == 74) ? r.p : nullptr;
  if (r.words != (argument ? 2 : 1)) {
    return fault(line, *r.module,
                 name(*r.module) + " stands alone on its line, but for " +
                     (code == 70                 ? "S"
                      : code == 72 || code == 74 ? "P"
                                                 : "nothing"));
  }
  if (argument && !(argument->value > 0)) {
    return fault(line, *argument, std::string(1, argument->letter) + " must be greater than 0");
  }
  Action action;
  action.kind = Action::Kind::kModule;
  action.module_code = code;
  if (argument) action.argument = argument->value;
  switch (code) {
    case 70:
      state.module_open = true;
      state.temperature_c = action.argument;
      break;
    case 71:
      state.module_open = false;
      state.extruding = false;
      break;
    case 72:
      state.extruding = true;
      state.filament_mm_per_s = action.argument;
      break;
    case 73:
      state.extruding = false;
      break;
    case 74:
      state.retracting = true;
      state.retract_mm = action.argument;
      break;
    default:
      state.retracting = false;
      break;
  }
  return action;
}

Status apply_modes(const Line& line, const Request& r, ModalState& state, Action& action) {
  if (r.unit) {
    state.unit = tenths(r.unit->value) == 200 ? LengthUnit::kInch : LengthUnit::kMillimetre;
  }
  if (r.distance) {
    state.distance = tenths(r.distance->value) == 900 ? Distance::kAbsolute : Distance::kRelative;
  }
  if (r.wcs) state.wcs = tenths(r.wcs->value) / 10;
  if (r.f) {
    if (!(r.f->value > 0)) return fault(line, *r.f, "the feed must be greater than 0");
    if (state.unit == LengthUnit::kUnset)
      return fault(line, *r.f, "G20 or G21 must come before a feed");
    state.feed_mm_per_min = r.f->value * (state.unit == LengthUnit::kInch ? 25.4 : 1.0);
  }
  if (r.s) {
    if (!(r.s->value >= 0)) return fault(line, *r.s, "the spindle speed cannot be negative");
    state.spindle_rpm = r.s->value;
    action.spindle_changed = state.spindle != Spindle::kOff;
  }
  if (r.spindle) {
    const int code = tenths(r.spindle->value) / 10;
    if (code != 5 && !state.spindle_rpm) {
      return fault(line, *r.spindle, name(*r.spindle) + " needs a spindle speed S");
    }
    state.spindle = code == 3   ? Spindle::kClockwise
                    : code == 4 ? Spindle::kCounterclockwise
                                : Spindle::kOff;
    action.spindle_changed = true;
  }
  if (r.coolant) state.coolant = tenths(r.coolant->value) != 90;
  if (r.motion) state.motion = tenths(r.motion->value) == 0 ? Motion::kRapid : Motion::kFeed;
  return Unit{};
}

Status apply_move(const Line& line, const Request& r, ModalState& state, Action& action) {
  const Word* first = nullptr;
  for (const Word* w : r.axes) {
    if (w && (!first || w->column < first->column)) first = w;
  }
  if (state.motion == Motion::kUnset)
    return fault(line, *first, "an axis moves before any G0 or G1");
  if (state.unit == LengthUnit::kUnset)
    return fault(line, *first, "G20 or G21 must come before motion");
  if (state.distance == Distance::kUnset) {
    return fault(line, *first, "G90 or G91 must come before motion");
  }
  if (state.motion == Motion::kFeed && !state.feed_mm_per_min) {
    return fault(line, *first, "G1 without a feed: F must come first");
  }
  const double inch = state.unit == LengthUnit::kInch ? 25.4 : 1.0;
  for (std::size_t axis = 0; axis < kAxes; ++axis) {
    const Word* word = r.axes[axis];
    if (!word) continue;
    const double value = word->value * (axis < 3 ? inch : 1.0);
    std::optional<double>& position = state.position[axis];
    if (state.distance == Distance::kAbsolute) {
      position = value;
    } else {
      if (!position) {
        return fault(line, *word,
                     std::string("a relative move of ") + word->letter +
                         " from a place that was never said");
      }
      position = *position + value;
    }
    action.moved[axis] = true;
  }
  action.kind = Action::Kind::kMove;
  return Unit{};
}

Result<Action> interpret(const Line& line, const Dialect& dialect, ModalState& state) {
  Request r;
  Status collected = collect(line, dialect, r);
  if (!collected) return collected.error();
  if (r.words == 0) return Action{};
  if (state.ended) return fault(line, *line.begin(), "the program goes on after its end");
  if (r.dwell) return apply_dwell(line, r, dialect);
  if (r.module) return apply_module(line, r, state);
  if (r.p) return fault(line, *r.p, "P belongs to G4, M72 or M74");
  if (r.end) {
    if (r.words != 1) return fault(line, *r.end, name(*r.end) + " stands alone on its line");
    state.ended = true;
    Action end;
    end.kind = Action::Kind::kEnd;
    return end;
  }
  Action action;
  Status modes = apply_modes(line, r, state, action);
  if (!modes) return modes.error();
  if (any_axis(r)) {
    Status moved = apply_move(line, r, state, action);
    if (!moved) return moved.error();
  }
  return action;
}

}  // namespace

Result<Action> apply(const Line& line, const Dialect& dialect, ModalState& state) {
  ModalState next = state;
  Result<Action> action = interpret(line, dialect, next);
  if (action) state = next;
  return action;
}

}  // namespace reforge::gcode

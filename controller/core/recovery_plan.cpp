#include "controller/core/recovery_plan.h"

#include <algorithm>
#include <cstdio>

#include "protocols/gcode/modal.h"

namespace reforge {
namespace {

constexpr double kPurgeMarginMm = 5;  // from the end of X's travel
constexpr double kPurgeSeconds = 3;

struct Checkpoint {
  LineNumber line = 0;
  std::optional<std::int64_t> path;  // none: a block's beginning
  gcode::ModalState state;           // before it
};

struct Bead {
  LineNumber on = 0;   // M72
  LineNumber off = 0;  // M73; 0: the program has none
};

struct Survey {
  std::vector<Checkpoint> checkpoints;
  std::vector<Bead> beads;
  double z_top_mm = 0;
  std::vector<std::string> modal_lines = {"G21", "G90", "G94", "G17", "G54"};
};

Error refuse(std::string why) {
  return {Code::kRefused, std::move(why)};
}

std::optional<Checkpoint> checkpoint_at(const gcode::Line& line, LineNumber n) {
  if (!line.empty()) return std::nullopt;
  Checkpoint out;
  out.line = n;
  long long path = 0;
  if (std::sscanf(line.comment.c_str(), "path %lld", &path) == 1) {
    out.path = path;
    return out;
  }
  if (line.comment.rfind("block ", 0) == 0) return out;
  return std::nullopt;
}

Result<Survey> survey(ProgramSource& program, const RigDescription& rig) {
  const gcode::Dialect dialect = gcode::dialect_of(rig.cnc, rig.kinematics.table);
  Survey out;
  gcode::ModalState state;
  gcode::Line line;
  for (LineNumber n = 1; n <= program.line_count(); ++n) {
    const Result<std::string_view> text = program.line(n);
    if (!text) return text.error();
    if (Status parsed = gcode::parse_line(*text, static_cast<std::size_t>(n), dialect, line);
        !parsed) {
      return parsed.error();
    }
    if (auto checkpoint = checkpoint_at(line, n)) {
      checkpoint->state = state;
      out.checkpoints.push_back(std::move(*checkpoint));
    }
    const auto action = gcode::apply(line, dialect, state);
    if (!action) return action.error();
    if (const auto& z = state.at(gcode::Axis::kZ)) out.z_top_mm = std::max(out.z_top_mm, *z);
    if (action->module_code == 72) out.beads.push_back({n, 0});
    if ((action->module_code == 73 || action->module_code == 71) && !out.beads.empty() &&
        out.beads.back().off == 0) {
      out.beads.back().off = n;
    }
  }
  return out;
}

std::string lines_text(const Bead& bead) {
  return "The bead of lines " + std::to_string(bead.on) + " to " + std::to_string(bead.off);
}

std::string word(char letter, double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%c%.4f", letter, value);
  std::string out = text;
  while (out.back() == '0') out.pop_back();
  if (out.back() == '.') out.pop_back();
  return out;
}

// The first checkpoint behind a line; null: there is none.
const Checkpoint* after(const Survey& survey, LineNumber line) {
  for (const Checkpoint& checkpoint : survey.checkpoints) {
    if (checkpoint.line > line) return &checkpoint;
  }
  return nullptr;
}

Result<Checkpoint> choose(const Survey& survey, const RecoveryRequest& request) {
  const LineCertainty& certainty = request.certainty;
  const LineNumber sent = request.sent_known ? certainty.sent : certainty.horizon;
  if (survey.checkpoints.empty()) {
    return refuse(
        "The program has no checkpoints (\"; path\" lines): it can only be started anew.");
  }
  const Checkpoint* chosen = nullptr;
  for (const Checkpoint& checkpoint : survey.checkpoints) {
    const bool asked = request.path ? checkpoint.path == request.path
                                    : checkpoint.line >= request.first_line &&
                                          checkpoint.line <= certainty.executed + 1;
    if (asked) chosen = &checkpoint;
  }
  if (request.path && chosen == nullptr) {
    return refuse("The program has no path " + std::to_string(*request.path) + ".");
  }
  if (chosen == nullptr) chosen = after(survey, request.first_line - 1);
  if (chosen == nullptr) return refuse("No checkpoint is left: nothing is to be done again.");
  for (const Bead& bead : survey.beads) {
    const bool begun = bead.on <= sent && bead.on >= request.first_line;
    const bool whole = bead.off > 0 && bead.off <= certainty.executed;
    if (bead.on < chosen->line || !begun) continue;
    if (!whole && request.bead == BeadWord::kNone) {
      return refuse(
          lines_text(bead) +
          " may be half laid. Look at it: recover again with the word \"removed\" once it "
          "is taken off, or \"accepted\" if it is good.");
    }
    if (!whole && request.bead == BeadWord::kRemoved) break;  // laid again from here on
    const Checkpoint* next = after(survey, bead.off);
    if (bead.off == 0 || next == nullptr) {
      return refuse(lines_text(bead) + " was the last: nothing is left to be made.");
    }
    if (request.path) return refuse(lines_text(bead) + " is laid already.");
    chosen = next;
  }
  return *chosen;
}

void add_position(std::vector<std::string>& lines, const char* motion, std::string words) {
  if (!words.empty()) lines.push_back(motion + words);
}

std::string axis_word(const gcode::ModalState& state, gcode::Axis axis, char letter) {
  const auto& value = state.at(axis);
  return value ? " " + word(letter, *value) : "";
}

void write_preamble(RecoveryPlan& plan, const gcode::ModalState& state, const Survey& survey,
                    const RigDescription& rig) {
  std::vector<std::string>& out = plan.preamble;
  const double top = survey.z_top_mm;
  const char tilt = rig.kinematics.table == RotaryTable::kBC ? 'B' : 'A';
  out = survey.modal_lines;
  if (plan.printing) {
    const double celsius = state.temperature_c.value_or(rig.extrusion.nozzle_temperature.value());
    out.push_back("M70 " + word('S', celsius));
  }
  out.push_back("G0 " + word('Z', top));
  add_position(out, "G0",
               axis_word(state, gcode::Axis::kTilt, tilt) + axis_word(state, gcode::Axis::kC, 'C'));
  if (plan.printing) {
    // Beside the part: the far end of X, where the nozzle is farthest from it.
    const double x = rig.x.max_mm - kPurgeMarginMm - rig.kinematics.g54_in_machine_mm.x;
    out.push_back("G0 " + word('X', x));
    out.push_back("M72");
    out.push_back("G4 " + word('P', kPurgeSeconds));
    out.push_back("M73");
    out.push_back("M74");
    out.push_back("M75");
  }
  add_position(out, "G0",
               axis_word(state, gcode::Axis::kX, 'X') + axis_word(state, gcode::Axis::kY, 'Y'));
  if (state.spindle != gcode::Spindle::kOff) {
    const char* code = state.spindle == gcode::Spindle::kClockwise ? "M3 " : "M4 ";
    out.push_back(code + word('S', state.spindle_rpm.value_or(rig.cutter.spindle_rpm)));
    out.push_back("G4 " + word('P', rig.spindle.spin_up_s));
  }
  const double feed = rig.cutter.ramp_feed_mm_per_s * 60;
  if (const auto& z = state.at(gcode::Axis::kZ)) {
    out.push_back("G1 " + word('Z', *z) + " " + word('F', feed));
  }
  if (state.feed_mm_per_min) out.push_back(word('F', *state.feed_mm_per_min));
  if (state.motion == gcode::Motion::kRapid) out.push_back("G0");
  if (state.motion == gcode::Motion::kFeed) out.push_back("G1");
}

}  // namespace

Result<RecoveryPlan> plan_recovery(ProgramSource& program, const RigDescription& rig,
                                   const RecoveryRequest& request) {
  const Result<Survey> surveyed = survey(program, rig);
  if (!surveyed) return surveyed.error();
  const Result<Checkpoint> from = choose(*surveyed, request);
  if (!from) return from.error();
  const gcode::ModalState& state = from->state;
  if (state.ended || state.extruding || state.retracting) {
    return refuse("Line " + std::to_string(from->line) +
                  " is no place to begin: filament is on the way there.");
  }
  RecoveryPlan plan;
  plan.from = from->line;
  plan.printing = state.module_open;
  if (state.spindle != gcode::Spindle::kOff) plan.bridge.push_back("M5");
  if (from->line > 1 && state.at(gcode::Axis::kZ)) {
    plan.bridge.push_back("G0 " + word('Z', surveyed->z_top_mm));
  }
  if (state.module_open) plan.bridge.push_back("M71");
  write_preamble(plan, state, *surveyed, rig);
  plan.first_line = from->line + static_cast<LineNumber>(plan.bridge.size());
  plan.lines =
      program.line_count() + static_cast<LineNumber>(plan.bridge.size() + plan.preamble.size());
  plan.sentence = "Goes on from line " + std::to_string(from->line) +
                  (from->path ? ", path " + std::to_string(*from->path) : ", a block's beginning") +
                  (plan.printing ? "; the nozzle is reheated before any axis moves" : "") + ".";
  return plan;
}

Status write_recovered(ProgramSource& program, const RecoveryPlan& plan,
                       const std::function<void(std::string_view)>& write_line) {
  for (LineNumber n = 1; n <= program.line_count(); ++n) {
    if (n == plan.from) {
      for (const std::string& line : plan.bridge) write_line(line);
      for (const std::string& line : plan.preamble) write_line(line);
    }
    const Result<std::string_view> text = program.line(n);
    if (!text) return text.error();
    write_line(*text);
  }
  return Unit{};
}

}  // namespace reforge

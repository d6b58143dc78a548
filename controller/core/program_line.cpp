#include "controller/core/program_line.h"

#include <cmath>
#include <cstdio>
#include <numbers>

namespace reforge {

namespace {

std::string at_line(LineNumber number) {
  return "Line " + std::to_string(number) + ": ";
}

// Filament speed at the rig's own feed and bead: what M72 without P means.
double configured_filament_speed(const Extrusion& e) {
  const double r = e.filament_diameter_mm / 2;
  return e.feed_mm_per_s * e.bead_width_mm * e.layer_height_mm / (std::numbers::pi * r * r) *
         e.multiplier;
}

}  // namespace

ProgramLineReader::ProgramLineReader(const RigDescription& rig)
    : extrusion_(rig.extrusion), dialect_(gcode::dialect_of(rig.cnc, rig.kinematics.table)) {}

Result<ProgramLine> ProgramLineReader::read(std::string_view text, LineNumber number) {
  if (Status parsed = gcode::parse_line(text, static_cast<std::size_t>(number), dialect_, line_);
      !parsed) {
    return parsed.error();
  }
  const gcode::ModalState before = modal_;
  Result<gcode::Action> action = gcode::apply(line_, dialect_, modal_);
  if (!action) return action.error();

  ProgramLine out;
  if (line_.empty()) {
    out.checkpoint = line_.comment.rfind("path ", 0) == 0 || line_.comment.rfind("block ", 0) == 0;
    return out;
  }
  out.kind = ProgramLine::Kind::kWords;
  out.words = gcode::compact(line_);
  out.dwell_s = action->dwell_s;
  if (action->kind == gcode::Action::Kind::kModule) {
    Result<ExtruderOrder> order = order_of(*action, before, number);
    if (!order) return order.error();
    out.kind = ProgramLine::Kind::kBarrier;
    out.order = *order;
  }
  return out;
}

Result<ExtruderOrder> ProgramLineReader::order_of(const gcode::Action& action,
                                                  const gcode::ModalState& before,
                                                  LineNumber number) const {
  const auto refuse = [&](const char* why) {
    return Result<ExtruderOrder>::fail(Code::kMalformed, at_line(number) + why);
  };
  const auto argument = [&](double otherwise) { return action.argument.value_or(otherwise); };
  switch (action.module_code) {
    case 70:
      if (before.extruding) return refuse("M70 while M72 is on; M73 must come first.");
      return ExtruderOrder{70, argument(extrusion_.nozzle_temperature.value())};
    case 72:
      if (!before.module_open) return refuse("M72 before M70: the extruder module is closed.");
      if (before.retracting) return refuse("M72 while M74 is on; M75 must come first.");
      return ExtruderOrder{72, argument(configured_filament_speed(extrusion_))};
    case 74:
      if (!before.module_open) return refuse("M74 before M70: the extruder module is closed.");
      if (before.extruding) return refuse("M74 while M72 is on; M73 must come first.");
      return ExtruderOrder{74, argument(extrusion_.retract_mm)};
    default:
      return ExtruderOrder{action.module_code, 0};
  }
}

Result<Point<MachineFrame>> g54_of_header(ProgramSource& program, const RigDescription& rig) {
  const gcode::Dialect dialect = gcode::dialect_of(rig.cnc, rig.kinematics.table);
  gcode::Line line;
  for (LineNumber n = 1; n <= program.line_count(); ++n) {
    Result<std::string_view> text = program.line(n);
    if (!text) return text.error();
    Status parsed = gcode::parse_line(*text, static_cast<std::size_t>(n), dialect, line);
    if (!parsed) return parsed.error();
    if (!line.empty()) break;
    Point<MachineFrame> g54;
    if (line.comment.rfind("g54:", 0) != 0) continue;
    // A finite number cannot exceed a machine; %lf would also take "nan".
    if (std::sscanf(line.comment.c_str(), "g54: X%lf Y%lf Z%lf", &g54.x, &g54.y, &g54.z) == 3 &&
        std::isfinite(g54.x) && std::isfinite(g54.y) && std::isfinite(g54.z)) {
      return g54;
    }
    return Result<Point<MachineFrame>>::fail(
        Code::kMalformed,
        at_line(n) + "the header's g54 is not of the form 'X1.000 Y2.000 Z3.000'.");
  }
  return Result<Point<MachineFrame>>::fail(
      Code::kMalformed,
      "The program's header has no g54 line, so nothing says where its origin is; plan it again.");
}

}  // namespace reforge

#include "planner/verify/extruder_rules.h"

#include <cmath>
#include <numbers>

namespace reforge::verify {
namespace {

constexpr double kWidthTolerance = 0.25;  // of the bead's width
constexpr double kDrySlack = 1.0;         // mm beyond the coast

}  // namespace

double ExtruderRules::section_mm2() const {
  return 0.25 * std::numbers::pi * rig_.filament_diameter_mm * rig_.filament_diameter_mm;
}

double ExtruderRules::filament_speed(const gcode::ModalState& state) const {
  if (state.filament_mm_per_s) return *state.filament_mm_per_s;
  return rig_.feed_mm_per_s * rig_.bead_width_mm * rig_.layer_height_mm / section_mm2() *
         rig_.multiplier;
}

double ExtruderRules::retract_seconds(const gcode::ModalState& state) const {
  return state.retract_mm.value_or(rig_.retract_mm) / rig_.retract_mm_per_s;
}

void ExtruderRules::module_code(const gcode::Action& action, const gcode::ModalState& before,
                                const Place& place, const Vec3& at) {
  const auto fault = [&](const char* sentence) {
    findings_.add(Fault::kModuleState, place.line, place.block, at, 0,
                  [&] { return std::string(sentence); });
  };
  switch (action.module_code) {
    case 70:
      if (before.extruding) fault("M70 while M72 is on");
      if (action.argument && (*action.argument < rig_.minimum_temperature.value() ||
                              *action.argument > rig_.maximum_temperature.value())) {
        fault("M70 asks for a temperature outside the extruder's range");
      }
      break;
    case 71:
      if (before.extruding) fault("M71 while M72 is on: M73 is missing");
      if (before.retracting) fault("M71 while M74 is on: M75 is missing");
      at_mouth_ = false;
      break;
    case 72:
      if (!before.module_open) fault("M72 before M70: the extruder is closed and cold");
      if (before.retracting) fault("M72 while M74 is on: M75 is missing");
      if (before.extruding) fault("M72 while extrusion is already on");
      at_mouth_ = true;
      dry_mm_ = travel_mm_ = 0;
      break;
    case 73:
      if (!before.extruding) fault("M73 without M72");
      dry_mm_ = travel_mm_ = 0;
      break;
    case 74:
      if (!before.module_open) fault("M74 before M70: the extruder is closed and cold");
      if (before.extruding) fault("M74 while M72 is on: M73 is missing");
      if (before.retracting) fault("M74 while it is already on");
      if (!at_mouth_) fault("M74 with the filament already retracted");
      at_mouth_ = false;
      break;
    default:
      if (!before.retracting) fault("M75 without M74");
      break;
  }
}

double ExtruderRules::move(const gcode::ModalState& state, bool rapid, double feed_mm_per_s,
                           const Vec3& delta, const Place& place, const Vec3& at) {
  const double across = delta.head<2>().norm();
  if (state.extruding) {
    if (rapid) {
      findings_.add(Fault::kExtrusionOnTravel, place.line, place.block, at, across,
                    [&] { return std::string("G0 while extrusion is on: M73 is missing"); });
      return 0;
    }
    const double speed = filament_speed(state);
    const double seconds = delta.norm() / feed_mm_per_s;
    filament_mm_ += speed * seconds;
    const double flow = speed * section_mm2() / rig_.multiplier;
    flow_mm3_ += flow * seconds;
    const double width = flow / (feed_mm_per_s * rig_.layer_height_mm);
    const double wanted = rig_.bead_width_mm;
    if (std::fabs(width - wanted) > kWidthTolerance * wanted) {
      findings_.add(Fault::kExtrusionRate, place.line, place.block, at, std::fabs(width - wanted),
                    [&] {
                      return "flow and feed make a bead " + millimetres(width) +
                             " mm wide; the rig's is " + millimetres(wanted) + " mm";
                    });
    }
    return width;
  }
  if (!rapid) {
    dry_mm_ += across;
    if (dry_mm_ > rig_.coast_mm + kDrySlack) {
      findings_.add(Fault::kExtrusionMissing, place.line, place.block, at, dry_mm_, [&] {
        return millimetres(dry_mm_) + " mm at feed with the module open and no extrusion";
      });
    }
    return 0;
  }
  if (at_mouth_) {
    travel_mm_ += across;
    if (travel_mm_ > rig_.travel_without_retract_mm + 1e-6) {
      findings_.add(Fault::kNotRetracted, place.line, place.block, at, travel_mm_, [&] {
        return "a travel of " + millimetres(travel_mm_) + " mm without retraction (M74 is missing)";
      });
    }
  }
  return 0;
}

void ExtruderRules::rotary(const gcode::ModalState& state, const Place& place, const Vec3& at) {
  if (state.extruding) {
    findings_.add(Fault::kExtrusionOnTravel, place.line, place.block, at, 0,
                  [] { return std::string("a rotary move while extrusion is on"); });
  }
  if (at_mouth_) {
    findings_.add(Fault::kNotRetracted, place.line, place.block, at, 0, [] {
      return std::string("a rotary move with filament at the mouth (M74 is missing)");
    });
  }
}

void ExtruderRules::dwell(const gcode::ModalState& state, double seconds) {
  if (!state.extruding) return;
  filament_mm_ += filament_speed(state) * seconds;
  flow_mm3_ += filament_speed(state) * section_mm2() / rig_.multiplier * seconds;
}

}  // namespace reforge::verify

#include "planner/verify/findings.h"

#include <cassert>
#include <cstdio>

namespace reforge::verify {

std::string_view name_of(Fault fault) {
  switch (fault) {
    case Fault::kNotUnderstood:
      return "not_understood";
    case Fault::kLineTooLong:
      return "line_too_long";
    case Fault::kHeader:
      return "header";
    case Fault::kStart:
      return "start_unknown";
    case Fault::kAxisLimit:
      return "axis_limit";
    case Fault::kFeedRange:
      return "feed_range";
    case Fault::kSpindleRange:
      return "spindle_range";
    case Fault::kRotaryNotAlone:
      return "rotary_not_alone";
    case Fault::kRotaryLow:
      return "rotary_low";
    case Fault::kModuleLow:
      return "module_low";
    case Fault::kModuleState:
      return "module_state";
    case Fault::kSpindleOff:
      return "spindle_off";
    case Fault::kSpindleOn:
      return "spindle_on";
    case Fault::kRapidInMaterial:
      return "rapid_in_material";
    case Fault::kGouge:
      return "gouge";
    case Fault::kCutterCollision:
      return "cutter_collision";
    case Fault::kHolderCollision:
      return "holder_collision";
    case Fault::kNozzleCollision:
      return "nozzle_collision";
    case Fault::kIdleCollision:
      return "idle_collision";
    case Fault::kNozzleDrag:
      return "nozzle_drag";
    case Fault::kBelowBase:
      return "below_base";
    case Fault::kExtrusionOnTravel:
      return "extrusion_on_travel";
    case Fault::kExtrusionMissing:
      return "extrusion_missing";
    case Fault::kExtrusionRate:
      return "extrusion_rate";
    case Fault::kNotRetracted:
      return "not_retracted";
    case Fault::kUnsupported:
      return "unsupported";
    case Fault::kDepositOutside:
      return "deposit_outside";
    case Fault::kEndState:
      return "end_state";
    case Fault::kDeviation:
      return "deviation";
    case Fault::kNotPrinted:
      return "not_printed";
    case Fault::kLeftOver:
      return "left_over";
    case Fault::kStarvation:
      return "starvation";
    case Fault::kNotAsPlanned:
      return "not_as_planned";
  }
  assert(false);
  return "";
}

std::string millimetres(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f", value);
  return text;
}

}  // namespace reforge::verify

#include "controller/core/start_checks.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "protocols/extruder_text.h"

namespace reforge {

namespace {

std::string axes_of(const RigDescription& rig) {
  return rig.kinematics.table == RotaryTable::kBC ? "XYZBC" : "XYZAC";
}

std::string coordinates(double x, double y, double z) {
  char text[96];
  std::snprintf(text, sizeof text, "X%.3f Y%.3f Z%.3f", x, y, z);
  return text;
}

std::optional<std::string> g54_refusal(const CncFacts& cnc, const Point<MachineFrame>& wanted) {
  if (!cnc.g54 || cnc.g54->axes < 3) return "The CNC did not report its G54 offset.";
  const auto& is = cnc.g54->offset;
  const double worst = std::max(
      {std::abs(is[0] - wanted.x), std::abs(is[1] - wanted.y), std::abs(is[2] - wanted.z)});
  // Written so that a reported NaN refuses.
  if (worst <= kG54ToleranceMm) return std::nullopt;
  return "The CNC's G54 is " + coordinates(is[0], is[1], is[2]) + " but the program was made for " +
         coordinates(wanted.x, wanted.y, wanted.z) +
         ": set the zero where the program expects it, or plan again for this clamping.";
}

}  // namespace

std::vector<std::string> start_refusals(const RigDescription& rig, bool ports_are_virtual,
                                        Mode mode) {
  std::vector<std::string> out;
  if (ports_are_virtual) return out;
  if (!rig.commissioned) {
    out.push_back("The rig file of " + rig.name +
                  " is not commissioned (nobody has measured signs, pivots and travels), so only "
                  "virtual ports may run; fill in 'commissioned' after measuring.");
  }
  if (mode == Mode::kPaper) {
    out.push_back(
        "The certificate is for the paper's constraints, which ignore table and fixture: it runs "
        "on "
        "virtual ports only; plan with --mode strict.");
  }
  return out;
}

std::vector<std::string> readiness_refusals(const CncFacts& cnc,
                                            const std::optional<wire::Status>& extruder,
                                            const Point<MachineFrame>& g54_of_program,
                                            bool recovers) {
  std::vector<std::string> out;
  if (!cnc.status || cnc.status->state != CncRunState::kIdle) {
    out.push_back("The CNC is not Idle but " +
                  std::string(cnc.status ? name(cnc.status->state) : "silent") + ".");
  }
  if (auto refusal = g54_refusal(cnc, g54_of_program)) out.push_back(*refusal);
  if (!extruder) {
    out.push_back("The extruder board has not reported its state.");
    return out;
  }
  if (extruder->fault != wire::Fault::kNone) {
    out.push_back("The extruder has a latched fault: " + std::string(sentence_of(extruder->fault)));
  }
  const bool open =
      extruder->state == wire::State::kStandby || extruder->state == wire::State::kReady;
  if (extruder->state != wire::State::kClosed && !(recovers && open)) {
    out.push_back("The extruder module is not closed but " + std::string(name_of(extruder->state)) +
                  ": bring Z clear of the part and clear the rig with leave to retreat.");
  }
  if ((extruder->flags & wire::kFlagRunPermitted) == 0) {
    out.push_back(
        "The extruder board does not permit the CNC to run: its hold output has dropped.");
  }
  return out;
}

std::optional<std::string> identity_refusal(const CncFacts& cnc, const RigDescription& rig) {
  const std::string wanted = axes_of(rig);
  if (cnc.axes == wanted) return std::nullopt;
  if (cnc.axes.empty()) {
    return "The device on the CNC's port does not say which axes it has; a grblHAL controller with "
           "axes " +
           wanted + " was expected.";
  }
  return "The device on the CNC's port has axes " + cnc.axes + ", the rig file needs " + wanted +
         ": check the ports and the rig file.";
}

}  // namespace reforge

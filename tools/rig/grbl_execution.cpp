// How the simulated CNC executes one line, in GRBL's order: modes, dwell, motion, program flow.
// Each step returns false while it has to wait.
#include <algorithm>
#include <cmath>
#include <utility>

#include "tools/rig/grbl_controller.h"

namespace reforge {
namespace {

constexpr int64_t kEepromNs = 20 * kNsPerMs;  // interrupts are off while it is written
constexpr double kMmPerInch = 25.4;
constexpr int kLinearAxes = 3;
constexpr double kTravelTolerance = 1e-6;

int64_t to_ns(double seconds) {
  return std::llround(seconds * 1e9);
}

}  // namespace

bool GrblController::step_sync() {
  const bool spindle_changes =
      pending_.spindle || (pending_.s && *pending_.s != modal_.rpm && modal_.spindle != 5);
  const bool offset_changes =
      pending_.coordinate_system && *pending_.coordinate_system != modal_.coordinate_system;
  const bool writes = pending_.non_modal == GcodeLine::NonModal::kSetCoordinates;
  const bool waits = spindle_changes || offset_changes || writes || pending_.coolant.has_value();
  if (waits && !motion_.empty()) return false;
  apply_modal();
  if (spindle_changes) event(CncEvent::Kind::kSpindle, spindle_rpm());
  stage_ = Stage::kDwell;
  return true;
}

// As the trace has it: the override and the spindle's own bounds included, 0 = off, M4 negative.
double GrblController::spindle_rpm() const {
  if (modal_.spindle == 5 || modal_.rpm == 0) return 0;
  const double rpm = std::clamp(modal_.rpm * spindle_percent_ / 100, min_rpm_, max_rpm_);
  return modal_.spindle == 3 ? rpm : -rpm;
}

void GrblController::apply_modal() {
  if (pending_.inches) modal_.inches = *pending_.inches;
  if (pending_.f) modal_.feed_per_min = *pending_.f * (modal_.inches ? kMmPerInch : 1);
  if (pending_.s) modal_.rpm = *pending_.s;
  if (pending_.t) modal_.tool = static_cast<int>(*pending_.t);
  if (pending_.spindle) modal_.spindle = *pending_.spindle;
  if (pending_.coolant) modal_.coolant = *pending_.coolant;
  if (pending_.incremental) modal_.incremental = *pending_.incremental;
  if (pending_.motion) modal_.motion = *pending_.motion;
  if (pending_.coordinate_system && *pending_.coordinate_system != modal_.coordinate_system) {
    modal_.coordinate_system = *pending_.coordinate_system;
    reports_to_offsets_ = 0;
  }
}

bool GrblController::step_dwell() {
  if (pending_.non_modal == GcodeLine::NonModal::kDwell) {
    if (!motion_.empty()) return false;
    if (dwell_left_ns_ < 0) {
      dwell_left_ns_ = to_ns(*pending_.p);
      ready_ns_ = now_ + dwell_left_ns_;
      event(CncEvent::Kind::kDwell, *pending_.p);
    }
    if (now_ < ready_ns_) return false;
  }
  stage_ = Stage::kMove;
  return true;
}

Axes GrblController::target() const {
  const bool machine = pending_.non_modal == GcodeLine::NonModal::kMachineCoordinates;
  Axes to = parser_position_;
  for (int i = 0; i < kAxisCount; ++i) {
    if (!pending_.axis[i]) continue;
    const double value = *pending_.axis[i] * (modal_.inches && i < kLinearAxes ? kMmPerInch : 1);
    if (machine) {
      to[i] = value;
    } else if (modal_.incremental) {
      to[i] += value;
    } else {
      to[i] = value + offsets_[modal_.coordinate_system][i];
    }
  }
  return to;
}

bool GrblController::within_travel(const Axes& machine) const {
  for (int i = 0; i < kAxisCount; ++i) {
    if (machine[i] < axes_.min[i] - kTravelTolerance) return false;
    if (machine[i] > axes_.max[i] + kTravelTolerance) return false;
  }
  return true;
}

bool GrblController::step_move() {
  if (pending_.non_modal == GcodeLine::NonModal::kSetCoordinates) {
    apply_g10();
    return true;
  }
  if (pending_.has_axes()) {
    const Axes to = target();
    if (settings_.at(20) != 0 && !within_travel(to)) {
      soft_limit_ = true;
      hold("soft limit");
      return true;
    }
    if (motion_.full()) return false;
    parser_position_ = to;
    motion_.append(to, modal_.motion == 0 ? 0 : modal_.feed_per_min / 60, lines_taken_);
  }
  stage_ = Stage::kFlow;
  return true;
}

void GrblController::apply_g10() {
  const int chosen = static_cast<int>(*pending_.p);
  Axes& offset = offsets_[chosen == 0 ? modal_.coordinate_system : chosen - 1];
  for (int i = 0; i < kAxisCount; ++i) {
    if (!pending_.axis[i]) continue;
    const double value = *pending_.axis[i] * (modal_.inches && i < kLinearAxes ? kMmPerInch : 1);
    offset[i] = *pending_.l == 2 ? value : parser_position_[i] - value;
  }
  reports_to_offsets_ = 0;
  stage_ = Stage::kStall;
  ready_ns_ = now_ + kEepromNs;
}

bool GrblController::step_flow() {
  if (pending_.flow != GcodeLine::Flow::kNone && !motion_.empty()) return false;
  if (pending_.flow == GcodeLine::Flow::kPause && !std::exchange(stop_asked_, true)) {
    hold("M0");
    return true;  // goes on here after the resume
  }
  if (pending_.flow == GcodeLine::Flow::kEnd) {
    const bool turned = modal_.spindle != 5;
    const Modal before = modal_;
    modal_ = {};
    modal_.inches = before.inches;
    modal_.rpm = before.rpm;
    modal_.tool = before.tool;
    modal_.feed_per_min = before.feed_per_min;
    modal_.motion = 1;  // RS274/NGC: program end leaves G1
    reports_to_offsets_ = 0;
    if (turned) event(CncEvent::Kind::kSpindle, 0);
    event(CncEvent::Kind::kEnd);
    send("[MSG:Pgm End]");
  }
  answer(0);
  return true;
}

// Z first, then the table's plane, then the rotary axes.
bool GrblController::step_home() {
  if (!motion_.empty()) return false;
  static constexpr std::array<std::array<bool, kAxisCount>, 3> kPhases{
      {{false, false, true, false, false},
       {true, true, false, false, false},
       {false, false, false, true, true}}};
  if (home_phase_ < static_cast<int>(kPhases.size())) {
    Axes to = motion_.planned_end();
    for (int i = 0; i < kAxisCount; ++i) {
      if (kPhases[home_phase_][i]) to[i] = axes_.home[i];
    }
    ++home_phase_;
    motion_.append(to, 0, 0);
    return true;
  }
  carried_ = {};
  alarm_ = 0;
  parser_position_ = motion_.position();
  event(CncEvent::Kind::kHomed);
  answer(0);
  return true;
}

}  // namespace reforge

#include "tools/rig/block_executor.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

namespace reforge {
namespace {

constexpr double kMmPerInch = 25.4;
constexpr int kLinearAxes = 3;
constexpr double kTravelTolerance = 1e-6;
constexpr double kJunctionDeviation_mm = 0.01;
// The board debounces its inputs for 10 ms; its answer before that is about the order before.
constexpr int64_t kCustomLeastNs = 30 * kNsPerMs;

MotionQueue::Limits limits_of(const CncAxes& axes) {
  return {axes.rate, axes.acceleration, kJunctionDeviation_mm};
}

}  // namespace

BlockExecutor::BlockExecutor(const RigDescription& rig, double dwell_seconds_per_p,
                             BeyondTravel beyond)
    : axes_(cnc_axes(rig)),
      dwell_seconds_per_p_(dwell_seconds_per_p),
      beyond_(beyond),
      min_rpm_(rig.spindle.min_rpm),
      max_rpm_(rig.spindle.max_rpm),
      motion_(limits_of(axes_), axes_.home),
      parser_position_(axes_.home) {
  offsets_[0] = axes_.g54_origin;
}

void BlockExecutor::event(CncEvent::Kind kind, double value, std::string text, int64_t line) {
  events_.push_back({now_, kind, g54_position(), value, line, std::move(text)});
}

std::vector<CncEvent> BlockExecutor::take_events() {
  return std::exchange(events_, {});
}

Axes BlockExecutor::position() const {
  Axes here = motion_.position();
  for (int i = 0; i < kAxisCount; ++i) here[i] += carried_[i];
  return here;
}

Axes BlockExecutor::g54_position() const {
  Axes here = position();
  for (int i = 0; i < kAxisCount; ++i) here[i] -= offsets_[0][i];
  return here;
}

void BlockExecutor::set_ready_input(bool ready) {
  ready_input_ = ready;
  pump();
}

bool BlockExecutor::take_end() {
  return std::exchange(ended_, false);
}

// --- time

int64_t BlockExecutor::next_event_ns() const {
  int64_t next = motion_.next_event_ns();
  if (pending_ && until_ns_ > now_ && !hold_ && alarm_ == 0) next = std::min(next, until_ns_);
  return next;
}

void BlockExecutor::advance_to(int64_t ns) {
  assert(ns >= now_);
  while (true) {
    const int64_t next = std::min(next_event_ns(), ns);
    now_ = std::max(now_, next);
    motion_.advance_to(now_);
    note_motion();
    pump();
    if (next_event_ns() > ns) break;
  }
  now_ = ns;
  motion_.advance_to(now_);
}

void BlockExecutor::note_motion() {
  for (const FinishedMove& move : motion_.take_finished()) {
    Axes g54 = move.end;
    for (int i = 0; i < kAxisCount; ++i) g54[i] += carried_[i] - offsets_[0][i];
    events_.push_back({move.ns, CncEvent::Kind::kMove, g54, move.speed, move.line, {}});
  }
  if (!hold_ || held_noted_ || !motion_.at_rest()) return;
  held_noted_ = true;
  event(CncEvent::Kind::kHeld);
  if (alarm_ != 0) {  // come to rest: the rest of the queue is lost
    motion_.abort();
    parser_position_ = motion_.position();
  }
}

// --- a block

void BlockExecutor::take(const GcodeLine& block, int64_t number) {
  assert(ready_for_block());
  pending_ = block;
  number_ = number;
  stage_ = Stage::kSync;
  until_ns_ = -1;
  pause_held_ = false;
  pump();
}

void BlockExecutor::home() {
  assert(drained());
  home_phase_ = 0;
  pending_.emplace();
  stage_ = Stage::kMove;
  pump();
}

void BlockExecutor::pump() {
  while (pending_ && !hold_ && alarm_ == 0) {
    if (!step()) return;
  }
}

// False while it has to wait.
bool BlockExecutor::step() {
  switch (stage_) {
    case Stage::kSync:
      if (needs_dry_queue() && !motion_.empty()) return false;
      apply_modes();
      stage_ = Stage::kCustom;
      return true;
    case Stage::kCustom:
      if (pending_->custom && !custom_done()) return false;
      until_ns_ = -1;
      stage_ = Stage::kDwell;
      return true;
    case Stage::kDwell:
      if (pending_->non_modal == GcodeLine::NonModal::kDwell && !dwell_done()) return false;
      stage_ = Stage::kMove;
      return true;
    case Stage::kMove:
      return move_done();
    case Stage::kFlow:
      if (pending_->flow == GcodeLine::Flow::kPause && !std::exchange(pause_held_, true)) {
        hold("M0");
        return true;
      }
      finish_block();
      return true;
  }
  return false;
}

bool BlockExecutor::needs_dry_queue() const {
  return pending_->custom || pending_->spindle || (pending_->s && spindle_ != 5) ||
         pending_->coolant || pending_->coordinate_system ||
         pending_->flow != GcodeLine::Flow::kNone ||
         pending_->non_modal == GcodeLine::NonModal::kDwell;
}

void BlockExecutor::apply_modes() {
  const GcodeLine& block = *pending_;
  if (block.inches) inches_ = *block.inches;
  if (block.incremental) incremental_ = *block.incremental;
  if (block.motion) motion_mode_ = *block.motion;
  if (block.coordinate_system) system_ = *block.coordinate_system;
  if (block.f) feed_per_min_ = *block.f * (inches_ ? kMmPerInch : 1);
  if (block.custom) return;  // its S is a temperature, not a speed
  if (block.s) rpm_ = *block.s;
  if (block.spindle) spindle_ = *block.spindle;
  if (block.spindle || (block.s && spindle_ != 5)) {
    const double rpm = spindle_ == 5 || rpm_ == 0 ? 0 : std::clamp(rpm_, min_rpm_, max_rpm_);
    event(CncEvent::Kind::kSpindle, spindle_ == 4 ? -rpm : rpm);
  }
}

bool BlockExecutor::custom_done() {
  if (until_ns_ < 0) {
    switch (*pending_->custom) {
      case 70:
      case 71:
        outputs_.open = *pending_->custom == 70;
        break;
      case 72:
      case 73:
        outputs_.extrude = *pending_->custom == 72;
        break;
      default:
        outputs_.retract = *pending_->custom == 74;
        break;
    }
    until_ns_ = now_ + kCustomLeastNs;
  }
  if (now_ < until_ns_ || !ready_input_) return false;
  event(CncEvent::Kind::kCustom, *pending_->custom);
  return true;
}

bool BlockExecutor::dwell_done() {
  if (until_ns_ < 0) {
    const double seconds = *pending_->p * dwell_seconds_per_p_;
    until_ns_ = now_ + std::llround(seconds * 1e9);
    event(CncEvent::Kind::kDwell, seconds);
  }
  return now_ >= until_ns_;
}

Axes BlockExecutor::target() const {
  Axes to = parser_position_;
  for (int i = 0; i < kAxisCount; ++i) {
    if (!pending_->axis[i]) continue;
    const double value = *pending_->axis[i] * (inches_ && i < kLinearAxes ? kMmPerInch : 1);
    if (pending_->non_modal == GcodeLine::NonModal::kMachineCoordinates) {
      to[i] = value;
    } else {
      to[i] = incremental_ ? to[i] + value : value + offsets_[system_][i];
    }
  }
  return to;
}

bool BlockExecutor::move_done() {
  static constexpr std::array<std::array<bool, kAxisCount>, 3> kHoming{
      {{false, false, true, false, false},
       {true, true, false, false, false},
       {false, false, false, true, true}}};
  if (home_phase_ >= 0) {
    if (!motion_.empty()) return false;
    if (home_phase_ < static_cast<int>(kHoming.size())) {
      Axes to = motion_.planned_end();
      for (int i = 0; i < kAxisCount; ++i) {
        if (kHoming[home_phase_][i]) to[i] = axes_.home[i];
      }
      ++home_phase_;
      motion_.append(to, 0, 0);
      return true;
    }
    home_phase_ = -1;
    carried_ = {};
    parser_position_ = motion_.position();
    event(CncEvent::Kind::kHomed);
  } else if (pending_->has_axes()) {
    Axes to = target();
    for (int i = 0; i < kAxisCount; ++i) {
      const double within = std::clamp(to[i], axes_.min[i], axes_.max[i]);
      if (std::abs(within - to[i]) <= kTravelTolerance) continue;
      if (beyond_ == BeyondTravel::kAlarm) {
        alarm(2);
        return true;
      }
      to[i] = within;
    }
    if (motion_.full()) return false;
    parser_position_ = to;
    motion_.append(to, motion_mode_ == 0 ? 0 : feed_per_min_ / 60, number_);
  }
  stage_ = Stage::kFlow;
  return true;
}

void BlockExecutor::finish_block() {
  if (pending_->flow == GcodeLine::Flow::kEnd) {
    if (spindle_ != 5) event(CncEvent::Kind::kSpindle, 0);
    spindle_ = 5;
    motion_mode_ = system_ = 0;
    incremental_ = false;
    ended_ = true;
    event(CncEvent::Kind::kEnd);
  }
  pending_.reset();
}

// --- hold, alarm, reset

void BlockExecutor::hold(const char* who) {
  if (hold_ || alarm_ != 0) return;
  hold_ = true;
  held_noted_ = false;
  if (until_ns_ >= 0) left_ns_ = std::max<int64_t>(0, until_ns_ - now_);
  event(CncEvent::Kind::kHold, 0, who);
  motion_.hold();
  note_motion();
}

void BlockExecutor::resume() {
  if (!hold_ || !held_noted_ || alarm_ != 0) return;
  hold_ = false;
  if (until_ns_ >= 0) until_ns_ = now_ + left_ns_;
  event(CncEvent::Kind::kResume);
  motion_.resume();
  pump();
}

// The outputs of a cycle fall; the module stays where it is until a reset.
void BlockExecutor::alarm(int number) {
  if (alarm_ != 0) return;
  alarm_ = number;
  pending_.reset();
  home_phase_ = -1;
  outputs_.extrude = outputs_.retract = false;
  event(CncEvent::Kind::kAlarm, number);
  if (spindle_ != 5) event(CncEvent::Kind::kSpindle, 0);
  spindle_ = 5;
  if (!hold_) {
    hold_ = true;
    held_noted_ = false;
    motion_.hold();
  }
  note_motion();
}

void BlockExecutor::clear() {
  const Axes carried = motion_.abort();
  for (int i = 0; i < kAxisCount; ++i) carried_[i] += carried[i];
  parser_position_ = motion_.position();
  pending_.reset();
  home_phase_ = -1;
  hold_ = false;
  alarm_ = 0;
  outputs_ = {};
  if (spindle_ != 5) event(CncEvent::Kind::kSpindle, 0);
  motion_mode_ = system_ = 0;
  spindle_ = 5;
  inches_ = incremental_ = false;
  feed_per_min_ = 0;
  event(CncEvent::Kind::kReset);
}

}  // namespace reforge

#include "tools/rig/panel_controller.h"

#include <algorithm>
#include <cassert>
#include <utility>

namespace reforge {
namespace {

constexpr char kXon = 0x11, kXoff = 0x13;
constexpr int64_t kLineNs = 2'000'000;  // reading and checking one block
// Alarm numbers are the simulation's own; what read_gcode finds wrong keeps its number.
constexpr int kNotHomed = 90, kBufferOverflow = 87, kLineTooLong = 88;

}  // namespace

PanelController::PanelController(const RigDescription& rig, bool homed, bool hold_input)
    : receive_buffer_bytes_(rig.cnc.receive_buffer_bytes),
      line_length_max_(rig.cnc.line_length_max),
      executor_(rig, 1e-3, BlockExecutor::BeyondTravel::kAlarm),
      homed_(homed),
      hold_input_(hold_input),
      tx_(1, kXon) {}

void PanelController::advance_to(int64_t ns) {
  assert(ns >= now_);
  while (true) {
    const int64_t next = std::min(next_event_ns(), ns);
    now_ = std::max(now_, next);
    executor_.advance_to(now_);
    pump();
    if (next_event_ns() > ns) break;
  }
  now_ = ns;
  executor_.advance_to(now_);
}

int64_t PanelController::next_event_ns() const {
  int64_t next = executor_.next_event_ns();
  if (line_read_ && ready_ns_ > now_) next = std::min(next, ready_ns_);
  return next;
}

void PanelController::receive(std::string_view bytes) {
  for (const char c : bytes) {
    if (executor_.alarm_number() != 0) return;
    if (static_cast<int>(rx_.size()) >= receive_buffer_bytes_) {
      executor_.event(CncEvent::Kind::kFault, 0, "the receive buffer overflowed: DC3 was ignored");
      executor_.alarm(kBufferOverflow);
      return;
    }
    rx_.push_back(c);
    steer_flow();
    pump();
  }
}

void PanelController::steer_flow() {
  const int held = static_cast<int>(rx_.size());
  if (!stopped_ && held * 4 >= receive_buffer_bytes_ * 3) {
    stopped_ = true;
    tx_ += kXoff;
  } else if (stopped_ && held * 4 <= receive_buffer_bytes_ && executor_.alarm_number() == 0) {
    stopped_ = false;
    tx_ += kXon;
  }
}

void PanelController::pump() {
  while (executor_.alarm_number() == 0) {
    if (executor_.take_end()) cycle_ = false;
    if (line_read_) {
      if (now_ < ready_ns_ || !executor_.ready_for_block()) return;
      line_read_ = false;
      begin_line();
    } else {
      if (rx_.empty()) return;
      const char c = rx_.front();
      rx_.pop_front();
      steer_flow();
      take_char(c);
    }
  }
}

void PanelController::take_char(char c) {
  if (c == '\r') return;
  if (c == '\n') {
    line_read_ = true;
    ready_ns_ = now_ + kLineNs;
    return;
  }
  ++raw_length_;
  if (comment_) {
    comment_ = c != ')';
  } else if (c == '(') {
    comment_ = true;
  } else if (c > ' ' && static_cast<int>(line_.size()) <= line_length_max_) {
    line_ += c;  // lower case is no character of it either
  }
}

void PanelController::begin_line() {
  std::string text = std::exchange(line_, {});
  const int length = std::exchange(raw_length_, 0);
  comment_ = false;
  if (text == "%") {
    reading_ = !reading_;
    if (reading_) cycle_ = true;
    return;
  }
  if (!reading_ || text.empty()) return;
  ++lines_taken_;
  executor_.event(CncEvent::Kind::kLine, 0, text, lines_taken_);
  if (!homed_) return executor_.alarm(kNotHomed);
  if (length > line_length_max_) return executor_.alarm(kLineTooLong);
  if (text[0] == 'O' && text.find_first_not_of("0123456789", 1) == std::string::npos) return;
  const GcodeReading reading = read_gcode(text, executor_.axes().letters, true);
  if (reading.error) return executor_.alarm(reading.error);
  feed_ = reading.line.f.value_or(feed_);
  if (reading.line.motion == 1 && feed_ == 0) return executor_.alarm(grbl_error::kFeedUndefined);
  executor_.take(reading.line, lines_taken_);
}

void PanelController::set_hold_input(bool asserted) {
  const bool edge = asserted && !hold_input_;
  hold_input_ = asserted;
  if (edge && cycle_) executor_.hold("input");
}

void PanelController::set_ready_input(bool ready) {
  executor_.set_ready_input(ready);
  pump();
}

CncOutputs PanelController::outputs() const {
  CncOutputs out = executor_.outputs();
  out.running = running();
  return out;
}

bool PanelController::running() const {
  return cycle_ && !executor_.held() && executor_.alarm_number() == 0;
}

std::string PanelController::state_name() const {
  if (executor_.alarm_number() != 0) return "Alarm";
  if (executor_.held()) return executor_.at_rest() ? "Hold:0" : "Hold:1";
  return cycle_ ? "Run" : "Idle";
}

void PanelController::press(CncButton button) {
  switch (button) {
    case CncButton::kHold:
      return executor_.hold("panel");
    case CncButton::kStart:
      if (!door_open_ && !hold_input_) executor_.resume();
      return pump();
    case CncButton::kReset:
      executor_.clear();
      rx_.clear();
      line_.clear();
      raw_length_ = 0;
      comment_ = reading_ = cycle_ = line_read_ = false;
      feed_ = 0;
      stopped_ = false;
      tx_ += kXon;
      return;
    case CncButton::kHome:
      homed_ = true;
      if (executor_.drained() && executor_.ready_for_block()) executor_.home();
      return;
    case CncButton::kDoorOpen:
      door_open_ = true;
      return executor_.hold("door");
    case CncButton::kDoorClose:
      door_open_ = false;
      return;
  }
}

std::string PanelController::take_transmitted() {
  return std::exchange(tx_, {});
}

}  // namespace reforge

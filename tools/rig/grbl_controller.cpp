#include "tools/rig/grbl_controller.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <utility>

namespace reforge {
namespace {

constexpr int64_t kLineNs = 400'000;  // reading, checking and planning one line
constexpr size_t kLineBuffer = 79;

}  // namespace

GrblController::GrblController(const RigDescription& rig, bool homed, bool hold_input)
    : axes_(cnc_axes(rig)),
      receive_buffer_bytes_(rig.cnc.receive_buffer_bytes),
      line_length_max_(rig.cnc.line_length_max),
      min_rpm_(rig.spindle.min_rpm),
      max_rpm_(rig.spindle.max_rpm),
      settings_(default_settings(rig, axes_)),
      motion_(motion_limits(), axes_.home),
      parser_position_(axes_.home),
      hold_input_(hold_input) {
  offsets_[0] = axes_.g54_origin;
  if (!homed) alarm_ = 11;  // grblHAL: homing required
  send_banner();
}

MotionQueue::Limits GrblController::motion_limits() const {
  MotionQueue::Limits limits{};
  for (int i = 0; i < kAxisCount; ++i) {
    limits.rate[i] = settings_.at(110 + i) / 60;
    limits.acceleration[i] = settings_.at(120 + i);
  }
  limits.junction_deviation_mm = settings_.at(11);
  return limits;
}

void GrblController::event(CncEvent::Kind kind, double value, std::string text) {
  events_.push_back({now_, kind, g54_position(), value, lines_taken_, std::move(text)});
}

std::vector<CncEvent> GrblController::take_events() {
  return std::exchange(events_, {});
}

std::string GrblController::take_transmitted() {
  return std::exchange(tx_, {});
}

Axes GrblController::position() const {
  return motion_.position();
}

Axes GrblController::physical_position() const {
  Axes here = motion_.position();
  for (int i = 0; i < kAxisCount; ++i) here[i] += carried_[i];
  return here;
}

Axes GrblController::g54_position() const {
  Axes here = physical_position();
  for (int i = 0; i < kAxisCount; ++i) here[i] -= offsets_[0][i];
  return here;
}

bool GrblController::running() const {
  return !hold_ && stage_ != Stage::kHome && !motion_.at_rest();
}

// --- time

int64_t GrblController::next_event_ns() const {
  int64_t next = motion_.next_event_ns();
  const bool timed = stage_ == Stage::kParse || stage_ == Stage::kStall ||
                     (stage_ == Stage::kDwell && dwell_left_ns_ >= 0);
  if (timed && !hold_ && !critical_) next = std::min(next, ready_ns_);
  return next;
}

void GrblController::advance_to(int64_t ns) {
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

void GrblController::note_motion() {
  for (const FinishedMove& move : motion_.take_finished()) {
    Axes g54 = move.end;
    for (int i = 0; i < kAxisCount; ++i) g54[i] += carried_[i] - offsets_[0][i];
    events_.push_back({move.ns, CncEvent::Kind::kMove, g54, move.speed, move.line, {}});
  }
  if (!hold_ || held_noted_ || !motion_.at_rest()) return;
  held_noted_ = true;
  event(CncEvent::Kind::kHeld);
  if (soft_limit_) raise_alarm(2);
}

// --- bytes

void GrblController::receive(std::string_view bytes) {
  for (const char c : bytes) {
    const auto byte = static_cast<unsigned char>(c);
    if (stage_ == Stage::kStall) {
      ++bytes_lost_;
      if (!std::exchange(losing_, true)) {
        event(CncEvent::Kind::kFault, 0, "bytes arrived while the EEPROM was written: lost");
      }
    } else if (byte == '?' || byte == '!' || byte == '~' || byte == 0x18 || byte >= 0x80) {
      real_time(byte);
    } else if (static_cast<int>(rx_.size()) >= receive_buffer_bytes_) {
      ++bytes_lost_;
      if (!std::exchange(losing_, true)) {
        event(CncEvent::Kind::kFault, 0, "the receive buffer overflowed: bytes lost");
      }
    } else {
      losing_ = false;
      rx_.push_back(c);
      unanswered_peak_ = std::max(unanswered_peak_, ++unanswered_);
    }
    pump();
  }
}

void GrblController::real_time(unsigned char c) {
  if (c == '?') report_status();
  if (c == '!') hold("host");
  if (c == '~') resume();
  if (c == 0x18) reset();
  if (c == 0x84) {
    hold("door");
    door_ = hold_;
  }
  override_by(c);
}

// grbl v1.1 "Commands": real-time overrides. True if it was one.
bool GrblController::override_by(unsigned char c) {
  static constexpr std::array<int, 5> kSteps{0, 10, -10, 1, -1};  // 0: back to 100
  const auto stepped = [](int percent, int step) { return step == 0 ? 100 : percent + step; };
  if (c >= 0x90 && c <= 0x94) {
    set_override(feed_percent_, stepped(feed_percent_, kSteps[c - 0x90]), "feed");
  } else if (c >= 0x95 && c <= 0x97) {
    set_override(rapid_percent_, c == 0x95 ? 100 : c == 0x96 ? 50 : 25, "rapid");
  } else if (c >= 0x99 && c <= 0x9D) {
    set_override(spindle_percent_, stepped(spindle_percent_, kSteps[c - 0x99]), "spindle");
    if (modal_.spindle != 5) event(CncEvent::Kind::kSpindle, spindle_rpm());
  } else {
    return false;
  }
  return true;
}

void GrblController::set_override(int& percent, int to, const char* which) {
  to = std::clamp(to, 10, 200);
  if (std::exchange(percent, to) == to) return;
  reports_to_overrides_ = 0;
  event(CncEvent::Kind::kOverride, to, which);
  motion_.set_overrides(feed_percent_ / 100.0, rapid_percent_ / 100.0);
}

void GrblController::press(CncButton button) {
  switch (button) {
    case CncButton::kHold:
      return hold("panel");
    case CncButton::kStart:
      return resume();
    case CncButton::kReset:
      return reset();
    case CncButton::kHome:
      if (motion_.empty() && stage_ == Stage::kNone) rx_.insert(rx_.begin(), {'$', 'H', '\n'});
      return pump();
    case CncButton::kDoorOpen:
      door_open_ = true;
      hold("door");
      door_ = hold_;
      return;
    case CncButton::kDoorClose:
      door_open_ = false;
      return;
  }
}

// The main loop of the real one: takes characters whenever it is not kept by a line.
void GrblController::pump() {
  while (!hold_ && !critical_) {
    if (stage_ != Stage::kNone) {
      if (!step()) return;
    } else {
      if (rx_.empty()) return;
      const char c = rx_.front();
      rx_.pop_front();
      take_char(c);
    }
  }
}

void GrblController::take_char(char c) {
  if (c == '\n' || c == '\r') {
    stage_ = Stage::kParse;
    ready_ns_ = now_ + kLineNs;
    return;
  }
  if (++raw_length_ > line_length_max_) overflow_ = true;
  if (comment_ == Comment::kParentheses && c == ')') {
    comment_ = Comment::kNone;
    return;
  }
  if (comment_ != Comment::kNone || c <= ' ' || c == '/') return;
  if (c == '(') {
    comment_ = Comment::kParentheses;
  } else if (c == ';') {
    comment_ = Comment::kToEnd;
  } else if (line_.size() >= kLineBuffer) {
    overflow_ = true;
  } else {
    line_ += c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  }
}

void GrblController::answer(int error) {
  send(error == 0 ? "ok" : "error:" + std::to_string(error));
  stage_ = Stage::kNone;
  // What stands in the receive buffer is all that is still unanswered.
  unanswered_ = static_cast<int>(rx_.size());
}

bool GrblController::step() {
  switch (stage_) {
    case Stage::kParse:
      if (now_ < ready_ns_) return false;
      begin_line();
      return true;
    case Stage::kSync:
      return step_sync();
    case Stage::kDwell:
      return step_dwell();
    case Stage::kMove:
      return step_move();
    case Stage::kFlow:
      return step_flow();
    case Stage::kStall:
      if (now_ < ready_ns_) return false;
      losing_ = false;
      answer(0);
      return true;
    case Stage::kHome:
      return step_home();
    case Stage::kNone:
      break;
  }
  return false;
}

void GrblController::begin_line() {
  const std::string text = std::exchange(line_, {});
  const bool overflow = std::exchange(overflow_, false);
  raw_length_ = 0;
  comment_ = Comment::kNone;
  if (overflow) return answer(grbl_error::kLineOverflow);
  if (text.empty()) return answer(0);
  ++lines_taken_;
  event(CncEvent::Kind::kLine, 0, text);
  if (text[0] == '$') {
    const int error = system_command(text);
    // Writing a setting or homing goes on by itself and answers in the end.
    if (stage_ == Stage::kParse) answer(error);
    return;
  }
  if (in_alarm()) return answer(grbl_error::kLocked);
  const GcodeReading reading = read_gcode(text, axes_.letters);
  const int error = reading.error ? reading.error : check_against_modal(reading.line);
  if (error) return answer(error);
  pending_ = reading.line;
  dwell_left_ns_ = -1;
  stop_asked_ = false;
  stage_ = Stage::kSync;
}

int GrblController::check_against_modal(const GcodeLine& line) const {
  const int motion = line.motion.value_or(modal_.motion);
  const bool moves = line.has_axes() && line.non_modal != GcodeLine::NonModal::kSetCoordinates;
  if (moves && motion == 80) return grbl_error::kAxisWordsUnused;
  if (line.non_modal == GcodeLine::NonModal::kMachineCoordinates && motion == 80) {
    return grbl_error::kG53Mode;
  }
  const bool feeds = line.motion == 1 || (moves && motion == 1);
  if (feeds && line.f.value_or(modal_.feed_per_min) == 0) return grbl_error::kFeedUndefined;
  return 0;
}

// --- hold, resume, reset, alarm

void GrblController::hold(const char* who) {
  if (hold_ || in_alarm() || stage_ == Stage::kHome) return;
  hold_ = true;
  held_noted_ = false;
  if (stage_ == Stage::kDwell && dwell_left_ns_ >= 0) dwell_left_ns_ = ready_ns_ - now_;
  event(CncEvent::Kind::kHold, 0, who);
  motion_.hold();
  note_motion();
}

void GrblController::resume() {
  if (!hold_ || !held_noted_ || door_open_) return;  // GRBL ignores it until at rest and shut
  hold_ = false;
  door_ = false;
  if (stage_ == Stage::kDwell && dwell_left_ns_ >= 0) ready_ns_ = now_ + dwell_left_ns_;
  event(CncEvent::Kind::kResume);
  motion_.resume();
  pump();
}

void GrblController::set_hold_input(bool asserted) {
  const bool edge = asserted && !hold_input_;
  hold_input_ = asserted;
  if (edge) hold("input");
}

void GrblController::raise_alarm(int number) {
  const Axes carried = motion_.abort();
  for (int i = 0; i < kAxisCount; ++i) carried_[i] += carried[i];
  parser_position_ = motion_.position();
  stage_ = Stage::kNone;
  hold_ = false;
  soft_limit_ = false;
  alarm_ = number;
  critical_ = number == 2;
  send("ALARM:" + std::to_string(number));
  event(CncEvent::Kind::kAlarm, number);
  if (critical_) send("[MSG:Reset to continue]");
}

void GrblController::reset() {
  const bool homing = stage_ == Stage::kHome;
  if (homing || !motion_.at_rest()) raise_alarm(homing ? 6 : 3);
  motion_.abort();
  parser_position_ = motion_.position();
  const bool turned = modal_.spindle != 5;
  modal_ = {};
  rx_.clear();
  line_.clear();
  raw_length_ = 0;
  overflow_ = false;
  comment_ = Comment::kNone;
  unanswered_ = 0;
  losing_ = false;
  stage_ = Stage::kNone;
  hold_ = false;
  door_ = false;
  soft_limit_ = false;
  critical_ = false;
  feed_percent_ = rapid_percent_ = spindle_percent_ = 100;
  motion_.set_overrides(1, 1);
  reports_to_offsets_ = 0;
  if (turned) event(CncEvent::Kind::kSpindle, 0);
  event(CncEvent::Kind::kReset);
  send_banner();
}

}  // namespace reforge

#include "controller/io/simulated_cnc.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace reforge {
namespace {

constexpr std::size_t kQueueMax = 16;

Duration seconds(double s) {
  return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(s));
}

double degrees(double radians) {
  return Radians::of(radians).in_degrees();
}

}  // namespace

SimulatedCnc::SimulatedCnc(const RigDescription& rig)
    : rig_(rig), dialect_(gcode::dialect_of(rig.cnc, rig.kinematics.table)) {
  say("GrblHAL 1.1f ['$' or '$HELP' for help]");
}

void SimulatedCnc::say(std::string_view text) {
  output_.append(text);
  output_ += "\r\n";
}

std::string SimulatedCnc::take_transmitted() {
  std::string out;
  out.swap(output_);
  return out;
}

void SimulatedCnc::receive(Instant now, std::string_view bytes) {
  advance(now);
  for (const char byte : bytes) {
    if (byte == '?' || byte == '!' || byte == '~' || byte == '\x18') {
      real_time(byte);
    } else if (static_cast<int>(received_.size()) >= rig_.cnc.receive_buffer_bytes) {
      ++bytes_lost_;
    } else {
      received_ += byte;
    }
  }
  parse();
}

void SimulatedCnc::real_time(char byte) {
  switch (byte) {
    case '?':
      return report_status();
    case '!':
      if (!held_ && !alarm_ && piece_ends_) piece_left_ = *piece_ends_ - now_;
      if (!alarm_ && !queue_.empty()) held_ = true;
      return;
    case '~':
      if (held_ && piece_ends_) piece_ends_ = now_ + piece_left_;
      held_ = false;
      return;
    default:
      return reset();
  }
}

void SimulatedCnc::reset() {
  const bool moved = piece_ends_ && !held_;
  received_.clear();
  queue_.clear();
  piece_ends_.reset();
  held_ = false;
  alarm_ = moved;
  modal_ = {};
  if (moved) say("ALARM:3");
  say("GrblHAL 1.1f ['$' or '$HELP' for help]");
}

void SimulatedCnc::report_status() {
  const char* state = alarm_ ? "Alarm" : held_ ? "Hold:0" : queue_.empty() ? "Idle" : "Run";
  const Point<MachineFrame>& g54 = rig_.kinematics.g54_in_machine_mm;
  char text[160];
  std::snprintf(text, sizeof text, "<%s|MPos:%.3f,%.3f,%.3f,%.3f,%.3f|FS:%.0f,%.0f>", state,
                at_[0] + g54.x, at_[1] + g54.y, at_[2] + g54.z, at_[3], at_[4],
                modal_.feed_mm_per_min.value_or(0),
                modal_.spindle == gcode::Spindle::kOff ? 0 : modal_.spindle_rpm.value_or(0));
  say(text);
}

void SimulatedCnc::advance(Instant now) {
  while (piece_ends_ && !held_ && *piece_ends_ <= now) {
    now_ = *piece_ends_;
    at_ = queue_.front().to;
    queue_.pop_front();
    piece_ends_.reset();
    if (!queue_.empty()) piece_ends_ = now_ + queue_.front().lasts;
    parse();
  }
  now_ = std::max(now_, now);
}

Instant SimulatedCnc::next_event() const {
  return piece_ends_ && !held_ ? *piece_ends_ : kNever;
}

void SimulatedCnc::parse() {
  while (!held_) {
    const std::size_t end = received_.find('\n');
    if (end == std::string::npos) return;
    if (!obey(received_.substr(0, end))) return;
    received_.erase(0, end + 1);
  }
}

bool SimulatedCnc::obey(const std::string& line) {
  char text[128];
  if (line == "$I") {
    say("[VER:1.1f.20230926:]");
    std::snprintf(text, sizeof text, "[OPT:VN,%zu,%d]", kQueueMax, rig_.cnc.receive_buffer_bytes);
    say(text);
    say(rig_.kinematics.table == RotaryTable::kBC ? "[AXS:5:XYZBC]" : "[AXS:5:XYZAC]");
  } else if (line == "$#") {
    const Point<MachineFrame>& g54 = rig_.kinematics.g54_in_machine_mm;
    std::snprintf(text, sizeof text, "[G54:%.3f,%.3f,%.3f,0.000,0.000]", g54.x, g54.y, g54.z);
    say(text);
  } else if (line == "$X") {
    alarm_ = false;
  } else if (alarm_) {
    say("error:9");
    return true;
  } else {
    return execute(line);
  }
  say("ok");
  return true;
}

bool SimulatedCnc::execute(const std::string& line) {
  if (queue_.size() >= kQueueMax) return false;
  if (!gcode::parse_line(line, 1, dialect_, line_)) {
    say("error:20");
    return true;
  }
  gcode::ModalState after = modal_;
  after.ended = false;
  const auto action = gcode::apply(line_, dialect_, after);
  if (!action || action->kind == gcode::Action::Kind::kModule) {
    say("error:20");
    return true;
  }
  const bool waits = action->kind == gcode::Action::Kind::kDwell || action->spindle_changed ||
                     action->kind == gcode::Action::Kind::kEnd;
  if (waits && !queue_.empty()) return false;
  const gcode::ModalState before = modal_;
  modal_ = after;
  enqueue(before, *action);
  // Of a dwell as of a move: it is queued, and the status says Run until it is over.
  say("ok");
  return true;
}

void SimulatedCnc::enqueue(const gcode::ModalState& before, const gcode::Action& action) {
  Piece piece{queue_.empty() ? at_ : queue_.back().to, Duration::zero()};
  if (action.kind == gcode::Action::Kind::kDwell) {
    piece.lasts = seconds(action.dwell_s);
  } else if (action.spindle_changed && before.spindle != modal_.spindle) {
    piece.lasts = seconds(rig_.spindle.spin_up_s);
  } else if (action.kind == gcode::Action::Kind::kMove) {
    const Position from = piece.to;
    const Position rapid = {rig_.x.rapid_mm_per_s, rig_.y.rapid_mm_per_s, rig_.z.rapid_mm_per_s,
                            degrees(rig_.tilt.rapid_rad_per_s), degrees(rig_.c.rapid_rad_per_s)};
    double time = 0;
    double length = 0;
    for (std::size_t i = 0; i < gcode::kAxes; ++i) {
      if (action.moved[i]) piece.to[i] = modal_.position[i].value_or(from[i]);
      const double way = std::abs(piece.to[i] - from[i]);
      time = std::max(time, way / rapid[i]);
      length = std::hypot(length, way);
    }
    if (modal_.motion == gcode::Motion::kFeed && modal_.feed_mm_per_min) {
      time = std::max(time, length * 60 / *modal_.feed_mm_per_min);
    }
    piece.lasts = seconds(time);
  } else {
    return;
  }
  queue_.push_back(piece);
  if (!piece_ends_) piece_ends_ = now_ + piece.lasts;
}

}  // namespace reforge

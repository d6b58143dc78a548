#include "planner/verify/replay.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

namespace reforge::verify {
namespace {

using gcode::Axis;
using gcode::ModalState;

constexpr double kClearSlack = 0.5;   // mm: beads stand out by half their width
constexpr double kLimitSlack = 1e-3;  // mm and degrees: decimals in the program
constexpr double kDecimals = 1e-3;    // mm
constexpr double kFeedLeast_mm_per_s = 0.1;
constexpr double kBaseSlack = 0.05;  // mm
constexpr double kWaitLeast_s = 2e-3;
constexpr double kAnyMachine = 1e4;  // mm and degrees: nothing beyond is simulated
constexpr double kSpinUpSlack_s = 0.01;
constexpr std::size_t kLinesPerReport = 2048;

double radians(double degrees) {
  return degrees * (std::numbers::pi / 180.0);
}

}  // namespace

ToolBodies tools_of(const RigDescription& rig, Mode mode) {
  if (mode == Mode::kPaper) return tool_bodies(paper_cutter(rig.cutter), paper_nozzle(rig.nozzle));
  return tool_bodies(rig.cutter, rig.nozzle);
}

double bridge_length(const Extrusion& e) {
  return std::max(2.0, 2.0 * e.bead_width_mm / std::max(e.infill, 0.05));
}

Replay::Replay(const RigDescription& rig, Mode mode, const std::string& stock_sha256,
               const TriangleMesh* fixture, Scene& scene, Findings& findings)
    : rig_(rig),
      mode_(mode),
      stock_sha256_(stock_sha256),
      fixture_(mode == Mode::kStrict ? fixture : nullptr),
      scene_(scene),
      findings_(findings),
      tools_(tools_of(rig, mode)),
      extruder_(rig.extrusion, findings),
      time_(rig),
      link_(rig.cnc),
      planned_(findings),
      pose_(pose_at(rig.kinematics, 0, 0)) {}

Pose Replay::pose_of(const ModalState& state) const {
  return pose_at(rig_.kinematics, radians(state.at(Axis::kTilt).value_or(0)),
                 radians(state.at(Axis::kC).value_or(0)));
}

std::optional<Vec3> Replay::programmed(const ModalState& state) const {
  if (!state.at(Axis::kX) || !state.at(Axis::kY) || !state.at(Axis::kZ)) return std::nullopt;
  return Vec3(*state.at(Axis::kX), *state.at(Axis::kY), *state.at(Axis::kZ));
}

Vec3 Replay::part_position() const {
  return pose_.to_part(programmed(state_).value_or(Vec3::Zero()));
}

Result<ReplayOutcome> Replay::run(std::istream& program, const ReplayOptions& options) {
  gcode::LineReader reader(program, gcode::dialect_of(rig_.cnc, rig_.kinematics.table));
  gcode::Line line;
  bool in_header = true;
  bool complete = true;
  for (;;) {
    const Result<bool> read = reader.next(line);
    if (!read || !*read) {
      outcome_.lines = reader.line_number();
      if (read) break;
      if (read.error().code == Code::kUnreadable) return read.error();
      const Fault fault =
          read.error().code == Code::kOutOfRange ? Fault::kLineTooLong : Fault::kNotUnderstood;
      findings_.add(fault, reader.line_number(), place_.block, part_position(), 0,
                    [&] { return read.error().sentence; });
      complete = false;
      break;
    }
    if (line.number % kLinesPerReport == 0) {
      if (options.progress) options.progress(line.number);
      if (options.should_stop && options.should_stop()) {
        outcome_.stopped = true;
        return outcome_;
      }
    }
    if (in_header) {
      in_header = line.empty() || line.words[0].letter == 'O';
      if (in_header) header_.take(line);
    }
    if (const std::optional<BlockComment> block = block_comment(line.comment)) {
      planned_.begin(block->number, line.number);
      place_.block = block->number;
      announced_ = block->direction;
      outcome_.blocks = std::max(outcome_.blocks, block->number);
    }
    if (line.empty()) {
      planned_.comment(line.comment, line.number);
      continue;
    }
    place_.line = line.number;
    unmoved_bytes_ += bytes_sent(line);
    const ModalState before = state_;
    const Result<gcode::Action> action = gcode::apply(line, reader.dialect(), state_);
    if (!action) {
      findings_.add(Fault::kNotUnderstood, line.number, place_.block, part_position(), 0,
                    [&] { return action.error().sentence; });
      outcome_.lines = reader.line_number();
      complete = false;
      break;
    }
    interpret(*action, before);
  }
  end(complete);
  return outcome_;
}

// Whether the link kept up with the moves whose durations are known by now.
void Replay::settle_link(bool at_rest) {
  const std::vector<double>& durations = time_.durations();
  for (std::size_t k = 0; k < durations.size(); ++k) {
    const Sent& sent = sent_[k];
    const double waited = link_.segment(sent.bytes, durations[k]);
    waited_s_ += waited;
    if (waited <= 0 || waited_s_ < kWaitLeast_s) continue;
    findings_.add(Fault::kStarvation, sent.place.line, sent.place.block, sent.at, 0, [&] {
      char text[160];
      std::snprintf(text, sizeof text,
                    "the link brings at most %d bytes a second: in mid-path the machine has stood "
                    "still for %.1f ms, waiting for lines",
                    rig_.cnc.baud / 10, waited_s_ * 1e3);
      return std::string(text);
    });
  }
  sent_.erase(sent_.begin(), sent_.begin() + static_cast<std::ptrdiff_t>(durations.size()));
  time_.forget_durations();
  if (!at_rest) return;
  link_.barrier();
  waited_s_ = 0;
}

void Replay::interpret(const gcode::Action& action, const ModalState& before) {
  if (action.spindle_changed) spindle();
  if (before.spindle == gcode::Spindle::kOff && state_.spindle != gcode::Spindle::kOff) {
    planned_.restarted();
  }
  switch (action.kind) {
    case gcode::Action::Kind::kNothing:
      break;
    case gcode::Action::Kind::kMove:
      move(action, before);
      break;
    case gcode::Action::Kind::kDwell:
      time_.dwell(action.dwell_s);
      pass_time(action.dwell_s);
      extruder_.dwell(state_, action.dwell_s);
      break;
    case gcode::Action::Kind::kModule:
      module_code(action, before);
      break;
    case gcode::Action::Kind::kEnd:
      time_.dwell(0);
      break;
  }
  const bool moves = action.kind == gcode::Action::Kind::kMove;
  const bool turns = moves && (action.moved[3] || action.moved[4]);
  const bool rests = !moves ? action.kind != gcode::Action::Kind::kNothing : turns;
  if (rests || action.spindle_changed || !time_.durations().empty()) {
    settle_link(rests || action.spindle_changed);
  }
  if (rests) unmoved_bytes_ = 0;
}

void Replay::spindle() {
  time_.dwell(0);
  spin_up_left_s_ = rig_.spindle.spin_up_s;
  if (state_.spindle == gcode::Spindle::kOff) return;
  const double rpm = state_.spindle_rpm.value_or(0);
  const double beyond = std::max(rig_.spindle.min_rpm - rpm, rpm - rig_.spindle.max_rpm);
  if (beyond > 0) {
    findings_.add(Fault::kSpindleRange, place_.line, place_.block, part_position(), 0, [&] {
      return "spindle speed " + millimetres(rpm) + " outside " + millimetres(rig_.spindle.min_rpm) +
             " to " + millimetres(rig_.spindle.max_rpm) + " rev/min";
    });
  }
  if (state_.spindle == gcode::Spindle::kCounterclockwise) {
    findings_.add(Fault::kSpindleRange, place_.line, place_.block, part_position(), 0,
                  [] { return std::string("M4 turns a right-hand cutter backwards"); });
  }
  if (state_.module_open) {
    findings_.add(Fault::kSpindleOn, place_.line, place_.block, part_position(), 0,
                  [] { return std::string("the spindle starts with the extruder open"); });
  }
}

double Replay::highest_at(const Pose& pose) const {
  double top = -std::numeric_limits<double>::infinity();
  const auto include = [&](const std::vector<Vec3>& points) {
    for (const Vec3& p : points) top = std::max(top, pose.to_machine(p).z());
  };
  include(scene_.outline());
  if (fixture_) include(fixture_->vertices);
  return top;
}

double Replay::tools_lowest(const Vec3& programmed, bool module_open) const {
  const Body& nozzle = module_open ? tools_.nozzle_deployed : tools_.nozzle_parked;
  return programmed.z() + std::min(0.0, nozzle.offset.z());
}

void Replay::low(Fault fault, double swept_top, const char* what) {
  const double height = state_.at(Axis::kZ)
                            ? tools_lowest(Vec3(0, 0, *state_.at(Axis::kZ)), state_.module_open)
                            : -std::numeric_limits<double>::infinity();
  const double missing = swept_top + rig_.clear_height_mm - height;
  if (missing <= kClearSlack) return;
  findings_.add(fault, place_.line, place_.block, part_position(), std::min(missing, 1e4), [&] {
    if (!state_.at(Axis::kZ)) return std::string(what) + " before the program has said where Z is";
    return std::string(what) + " with the tools " + millimetres(height - swept_top) +
           " mm above what stands there; " + millimetres(rig_.clear_height_mm) + " mm are asked";
  });
}

void Replay::module_code(const gcode::Action& action, const ModalState& before) {
  scene_.end_bead();
  time_.dwell(action.module_code == 74 || action.module_code == 72
                  ? extruder_.retract_seconds(state_)
                  : 0.0);
  extruder_.module_code(action, before, place_, part_position());
  if (action.module_code == 70 || action.module_code == 71) {
    if (before.module_open || action.module_code == 70) {
      low(Fault::kModuleLow, highest_at(pose_),
          action.module_code == 70 ? "the extruder opens (M70)" : "the extruder closes (M71)");
    }
    if (action.module_code == 70 && state_.spindle != gcode::Spindle::kOff) {
      findings_.add(Fault::kSpindleOn, place_.line, place_.block, part_position(), 0,
                    [] { return std::string("the extruder opens with the spindle turning"); });
    }
  }
}

void Replay::judge_limits(const ModalState& state) {
  if (mode_ == Mode::kPaper) return;
  const auto judge = [&](const char* axis, double value, double lo, double hi, const char* unit) {
    const double beyond = std::max(lo - value, value - hi);
    if (beyond <= kLimitSlack) return;
    findings_.add(Fault::kAxisLimit, place_.line, place_.block, part_position(), beyond, [&] {
      return std::string(axis) + " at " + millimetres(value) + unit + " of the machine, beyond " +
             millimetres(lo) + " to " + millimetres(hi);
    });
  };
  const Point<MachineFrame>& g54 = rig_.kinematics.g54_in_machine_mm;
  if (state.at(Axis::kX))
    judge("X", *state.at(Axis::kX) + g54.x, rig_.x.min_mm, rig_.x.max_mm, " mm");
  if (state.at(Axis::kY))
    judge("Y", *state.at(Axis::kY) + g54.y, rig_.y.min_mm, rig_.y.max_mm, " mm");
  if (state.at(Axis::kZ))
    judge("Z", *state.at(Axis::kZ) + g54.z, rig_.z.min_mm, rig_.z.max_mm, " mm");
  if (state.at(Axis::kTilt)) {
    judge("the tilt axis", *state.at(Axis::kTilt), rig_.tilt.min.in_degrees(),
          rig_.tilt.max.in_degrees(), " degrees");
  }
  if (state.at(Axis::kC)) {
    judge("C", *state.at(Axis::kC), rig_.c.min.in_degrees(), rig_.c.max.in_degrees(), " degrees");
  }
}

void Replay::move(const gcode::Action& action, const ModalState& before) {
  ++outcome_.moves;
  const bool turns = action.moved[3] || action.moved[4];
  const bool shifts = action.moved[0] || action.moved[1] || action.moved[2];
  judge_limits(state_);
  for (const ModalState* state : {&before, static_cast<const ModalState*>(&state_)}) {
    for (const std::optional<double>& place : state->position) {
      if (!place || std::fabs(*place) <= kAnyMachine) continue;
      findings_.add(Fault::kAxisLimit, place_.line, place_.block, Vec3::Zero(), kAnyMachine, [&] {
        return "a place of " + millimetres(*place) + " is on no machine; not simulated";
      });
      return;
    }
  }
  if (state_.wcs != 54) {
    findings_.add(Fault::kHeader, place_.line, place_.block, part_position(), 0, [&] {
      return "G" + std::to_string(state_.wcs) + ": the part is clamped at G54";
    });
  }
  if (turns) rotary(before, !shifts && state_.motion == gcode::Motion::kRapid);
  if (shifts) linear(before);
}

void Replay::rotary(const ModalState& before, bool alone) {
  scene_.end_bead();
  if (!alone) {
    findings_.add(Fault::kRotaryNotAlone, place_.line, place_.block, part_position(), 0, [] {
      return std::string("rotary axes turn only at G0 and alone on their line");
    });
  }
  extruder_.rotary(state_, place_, part_position());
  const double tilt0 = radians(before.at(Axis::kTilt).value_or(0));
  const double c0 = radians(before.at(Axis::kC).value_or(0));
  const double tilt1 = radians(state_.at(Axis::kTilt).value_or(0));
  const double c1 = radians(state_.at(Axis::kC).value_or(0));
  // The controller may run both axes in step or each at its own rate: all of the way in steps of 5
  // degrees of either.
  const double way = std::max(std::fabs(tilt1 - tilt0), std::fabs(c1 - c0));
  const int steps = static_cast<int>(std::clamp(std::ceil(way / radians(5)), 1.0, 144.0));
  double top = -std::numeric_limits<double>::infinity();
  if (tilt0 == tilt1) {  // heights do not change while only C turns at no tilt
    for (int k = 0; k <= (tilt0 == 0 ? 0 : steps); ++k) {
      top = std::max(top, highest_at(pose_at(rig_.kinematics, tilt0, c0 + (c1 - c0) * k / steps)));
    }
  } else {
    for (int k = 0; k <= steps; ++k) {
      const double share = static_cast<double>(k) / steps;
      top = std::max(top, highest_at(pose_at(rig_.kinematics, tilt0 + (tilt1 - tilt0) * share,
                                             c0 + (c1 - c0) * share)));
    }
  }
  low(Fault::kRotaryLow, top, "rotary axes turn");
  time_.turn(tilt1 - tilt0, c1 - c0);
  pose_ = pose_of(state_);
}

void Replay::judge_feed(const Vec3& delta) {
  const double feed = *state_.feed_mm_per_min / 60.0;
  const double length = delta.norm();
  double most = std::numeric_limits<double>::infinity();
  const std::array<double, 3> limits{rig_.x.max_feed_mm_per_s, rig_.y.max_feed_mm_per_s,
                                     rig_.z.max_feed_mm_per_s};
  for (int k = 0; k < 3; ++k) {
    // The program's decimals turn a short move a little.
    const double share = (std::fabs(delta[k]) - kDecimals) / length;
    if (share > 1e-9) most = std::min(most, limits[static_cast<std::size_t>(k)] / share);
  }
  const bool tool_limits = !state_.module_open;
  if (tool_limits) most = std::min(most, rig_.cutter.feed_mm_per_s);
  if (feed <= most * 1.001 && feed >= kFeedLeast_mm_per_s) return;
  findings_.add(Fault::kFeedRange, place_.line, place_.block, part_position(),
                std::max(0.0, feed - most), [&] {
                  return "feed " + millimetres(feed * 60) + " mm/min; " +
                         (tool_limits ? "cutter and axes allow " : "the axes allow ") +
                         millimetres(most * 60) + " here, and no less than 6";
                });
}

// Whether the tool comes from where the block's comment says.
void Replay::judge_direction() {
  if (!announced_ || (*announced_ - pose_.tool_axis()).norm() < 1e-3) return;
  const Vec3 said = *announced_, is = pose_.tool_axis();
  announced_.reset();  // once a block
  findings_.add(Fault::kHeader, place_.line, place_.block, part_position(), 0, [&] {
    const auto text = [](const Vec3& v) {
      return "(" + millimetres(v.x()) + ", " + millimetres(v.y()) + ", " + millimetres(v.z()) + ")";
    };
    return "the block is for direction " + text(said) + ", but the tool comes from " + text(is);
  });
}

void Replay::linear(const ModalState& before) {
  const bool rapid = state_.motion == gcode::Motion::kRapid;
  const std::optional<Vec3> from = programmed(before);
  const std::optional<Vec3> to = programmed(state_);
  if (!from) {
    const double z0 = before.at(Axis::kZ).value_or(std::numeric_limits<double>::infinity());
    const double z1 = state_.at(Axis::kZ).value_or(-std::numeric_limits<double>::infinity());
    const double height = tools_lowest(Vec3(0, 0, std::min(z0, z1)), state_.module_open);
    const double top = highest_at(pose_);
    if (height < top) {
      findings_.add(Fault::kStart, place_.line, place_.block, part_position(),
                    std::min(top - height, 1e4), [] {
                      return std::string(
                          "moves near the part before the program has said where X, Y "
                          "and Z are; first Z alone to the clear height, then X and Y");
                    });
    }
    return;
  }
  const Vec3 delta = *to - *from;
  if (delta.isZero(0)) return;
  const Vec3 at = pose_.to_part(*to);
  if (!rapid) judge_feed(delta);
  if (!rapid) judge_direction();
  const double feed = rapid ? 0 : *state_.feed_mm_per_min / 60.0;
  time_.move({delta.x(), delta.y(), delta.z()}, rapid ? std::nullopt : std::optional<double>(feed));
  sent_.push_back({unmoved_bytes_, place_, at});
  unmoved_bytes_ = 0;
  const bool at_speed = state_.spindle != gcode::Spindle::kOff && spin_up_left_s_ <= kSpinUpSlack_s;
  pass_time(delta.norm() / (rapid ? rig_.z.rapid_mm_per_s : feed));
  SceneMove m{
      pose_, *from, *to, rapid, state_.module_open, at_speed, 0, rig_.extrusion.layer_height_mm};
  if (state_.module_open || state_.extruding) {
    m.bead_width = extruder_.move(state_, rapid, feed, delta, place_, at);
  }
  if (m.bead_width > 0) {
    const Vec3 offset = pose_.turn * tools_.nozzle_deployed.offset;
    planned_.add(pose_.to_part(*from) + offset, at + offset,
                 m.bead_width * m.bead_height * delta.norm());
  } else if (!rapid && !state_.module_open) {
    planned_.add(pose_.to_part(*from), at, 0);
  }
  if (!rapid && (mode_ == Mode::kPaper || !fixture_)) {
    Vec3 offset = Vec3::Zero();
    if (state_.module_open) offset = pose_.turn * tools_.nozzle_deployed.offset;
    const double below = -std::min((pose_.to_part(*from) + offset).z(), (at + offset).z());
    if (below > kBaseSlack) {
      findings_.add(Fault::kBelowBase, place_.line, place_.block, at, below, [&] {
        return "the tool tip is " + millimetres(below) + " mm below the base the part stands on";
      });
    }
  }
  scene_.move(m, place_);
}

void Replay::end(bool complete) {
  scene_.finish();
  planned_.end(outcome_.lines);
  outcome_.seconds = time_.seconds();
  settle_link(true);
  header_.compare(rig_, mode_, stock_sha256_, findings_);
  const auto fault = [&](const char* sentence) {
    findings_.add(Fault::kEndState, outcome_.lines, place_.block, part_position(), 0,
                  [&] { return std::string(sentence); });
  };
  if (complete) {
    if (!state_.ended) fault("the program has no end (M2 or M30)");
    if (state_.extruding) fault("the program ends with extrusion on");
    if (state_.module_open)
      fault("the program ends with the extruder open and hot: M71 is missing");
    if (state_.spindle != gcode::Spindle::kOff) {
      fault("the program ends with the spindle turning: M5 is missing");
    }
  }
  outcome_.filament_mm = extruder_.filament_mm();
  outcome_.flow_mm3 = extruder_.flow_mm3();
}

}  // namespace reforge::verify

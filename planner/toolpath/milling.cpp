#include "planner/toolpath/milling.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/toolpath/arc_length.h"
#include "planner/toolpath/region.h"

namespace reforge {
namespace {

constexpr double kFixtureMargin = 0.5;  // mm between cutter and what holds the part
constexpr double kApproach = 0.5;       // mm above stock where a rapid down ends
constexpr double kRampSlope = 0.07;     // 4 degrees
constexpr double kRampStep = 0.5;  // mm along a ramp: corners are cut by no more than its sagitta
constexpr double kRampLaps = 30;
constexpr double kShortestRamp = 0.3;   // mm of line: up to 10 degrees there
constexpr double kDepthLookAhead = 20;  // mm of line asked for stock before ramping along it

}  // namespace

MillingOptions milling_options(const RigDescription& rig, Mode mode) {
  MillingOptions options;
  options.cutter = cutter_of(rig, mode);
  options.stepdown_mm = rig.cutter.stepdown_mm;
  options.stepover_mm = rig.cutter.stepover_mm;
  options.allowance_mm = rig.roughing_allowance_mm;
  options.scallop_mm = rig.scallop_mm;
  options.tip_above_base = mode == Mode::kPaper;
  return options;
}

TipFloor::TipFloor(const Surroundings& solids, const Frame& frame, const MillingOptions& options,
                   double allowance_mm)
    : ball_(options.cutter.ball_radius_mm),
      part_(solids.reused, frame, ball_ + allowance_mm),
      fixture_(solids.fixture, frame, ball_ + kFixtureMargin),
      tip_above_base_(options.tip_above_base),
      base_per_v_(frame.v.z()),
      base_per_d_(frame.d.z()) {}

double TipFloor::base(double v) const {
  // The frame's u is horizontal, so only v and the height itself carry the tip above the base.
  if (!tip_above_base_) return kNothingBelow;
  if (base_per_d_ > 1e-9) return -v * base_per_v_ / base_per_d_;
  return v * base_per_v_ < 0 ? std::numeric_limits<double>::infinity() : kNothingBelow;
}

double TipFloor::operator()(double u, double v) const {
  return std::max({part_.centre(u, v) - ball_, fixture_.centre(u, v) - ball_, base(v)});
}

bool TipFloor::allows(double u, double v, double tip) const {
  return base(v) <= tip && !part_.is_above(u, v, tip + ball_) &&
         !fixture_.is_above(u, v, tip + ball_);
}

void PathWriter::move(const Vec3& to, Motion motion) {
  std::vector<Move>& moves = out_.back().moves;
  if (motion != Motion::kRapid) stock_.cut(moves.back().to, to);
  if (moves.size() > 1 && moves.back().motion == motion && motion != Motion::kRapid) {
    // Straight on: one move instead of two.
    const Vec3 before = moves.back().to - moves[moves.size() - 2].to, now = to - moves.back().to;
    if (before.dot(now) > 0 && before.cross(now).norm() < 1e-7 * before.norm()) moves.pop_back();
  }
  moves.push_back({to, motion});
}

void PathWriter::come_down_to(const Vec3& start) {
  const Vec2 over(start.x(), start.y());
  const bool first = out_.empty();
  const Vec2 from = first ? over : Vec2(position().x(), position().y());
  const double height =
      std::max({clearance_.link_height(from, over), start.z(), first ? start.z() : position().z()});
  const Vec3 before = first ? Vec3(over.x(), over.y(), height) : position();
  out_.emplace_back();
  if (before.z() < height) move({from.x(), from.y(), height}, Motion::kRapid);
  move({over.x(), over.y(), height}, Motion::kRapid);
  if (height > start.z()) {
    // What the ball's side may still shave on the way down is met at feed, not at a rapid.
    const double touched = stock_.touch_depth(start);
    const double slow_from = touched > 0 ? start.z() + touched + kApproach : start.z();
    if (slow_from < height) move({start.x(), start.y(), slow_from}, Motion::kRapid);
    if (touched > 0) move(start, Motion::kLower);
  }
  working_ = true;
}

bool PathWriter::enter(const std::vector<Vec3>& line, bool closed, double clear_mm) {
  const double here = stock_.loose_depth(line.front());
  if (here < -clear_mm) {
    come_down_to(line.front() + Vec3(0, 0, std::min(-here, kApproach)));
    move(line.front(), Motion::kRamp);
    return true;
  }
  const ArcLength<Vec3> walk(line, closed);
  const double length = walk.length();
  if (length < kShortestRamp) return false;
  double deepest = here;
  const int samples = std::max(2, static_cast<int>(std::min(length, kDepthLookAhead) / 0.4));
  for (int i = 0; i <= samples; ++i) {
    const double t = std::min(length, kDepthLookAhead) * i / samples;
    deepest = std::max(deepest, stock_.loose_depth(walk.before_start(t)));
  }
  // Heights above the line fall along the ramp; a short line is run along at most kRampLaps times.
  const double rise = std::max(0.0, deepest) + clear_mm;
  const double run = std::min(rise / kRampSlope, kRampLaps * length);
  const int steps = static_cast<int>(std::ceil(run / std::min(kRampStep, length / 4)));
  const auto ramp_at = [&](int i) {
    return Vec3(walk.before_start(run * i / steps) + Vec3(0, 0, rise * i / steps));
  };
  come_down_to(ramp_at(steps));
  for (int i = steps - 1; i >= 0; --i) move(ramp_at(i), Motion::kRamp);
  return true;
}

void PathWriter::cut_to(const Vec3& tip) {
  if ((tip - position()).squaredNorm() > 1e-12) move(tip, Motion::kCut);
}

}  // namespace reforge

#include "planner/verify/time_model.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace reforge::verify {
namespace {

constexpr double kJunctionDeviation = 0.01;  // mm, grbl's default
constexpr std::size_t kLookAhead = 1024;

// From v0 to v1 over `length`, at most `speed`.
double trapezoid(double length, double v0, double v1, double speed, double acceleration) {
  const double peak_squared = acceleration * length + 0.5 * (v0 * v0 + v1 * v1);
  const double peak = std::min(speed, std::sqrt(std::max(peak_squared, 0.0)));
  const double top = std::max({peak, v0, v1});
  const double up = (top * top - v0 * v0) / (2 * acceleration);
  const double down = (top * top - v1 * v1) / (2 * acceleration);
  const double level = std::max(0.0, length - up - down);
  return (top - v0) / acceleration + (top - v1) / acceleration + (top > 0 ? level / top : 0.0);
}

}  // namespace

void TimeModel::move(const std::array<double, 3>& delta, std::optional<double> feed) {
  const double length = std::hypot(delta[0], delta[1], delta[2]);
  if (length <= 0) return;
  Segment s{length,
            std::numeric_limits<double>::infinity(),
            std::numeric_limits<double>::infinity(),
            0,
            {}};
  const std::array<const LinearAxis*, 3> axes{&rig_.x, &rig_.y, &rig_.z};
  for (std::size_t k = 0; k < 3; ++k) {
    s.unit[k] = delta[k] / length;
    const double share = std::fabs(s.unit[k]);
    if (share < 1e-9) continue;
    const double limit = feed ? axes[k]->max_feed_mm_per_s : axes[k]->rapid_mm_per_s;
    s.speed = std::min(s.speed, limit / share);
    s.acceleration = std::min(s.acceleration, axes[k]->acceleration_mm_per_s2 / share);
  }
  if (feed) s.speed = std::min(s.speed, *feed);
  if (!pending_.empty()) {
    const Segment& before = pending_.back();
    double cosine = 0;
    for (std::size_t k = 0; k < 3; ++k) cosine -= before.unit[k] * s.unit[k];
    const double half_sine = std::sqrt(std::max(0.0, 0.5 * (1 - cosine)));
    const double straight = std::min(before.speed, s.speed);
    double corner = straight * straight;
    if (half_sine < 1 - 1e-9) {
      corner = std::min(corner, std::min(before.acceleration, s.acceleration) * kJunctionDeviation *
                                    half_sine / (1 - half_sine));
    }
    s.entry_squared = corner;
  }
  pending_.push_back(s);
  if (pending_.size() == kLookAhead) rest();
}

void TimeModel::rest() {
  double exit_squared = 0;
  for (std::size_t k = pending_.size(); k-- > 0;) {
    Segment& s = pending_[k];
    s.entry_squared = std::min(s.entry_squared, exit_squared + 2 * s.acceleration * s.length);
    exit_squared = s.entry_squared;
  }
  double entry_squared = 0;
  for (std::size_t k = 0; k < pending_.size(); ++k) {
    const Segment& s = pending_[k];
    double leave_squared = k + 1 < pending_.size() ? pending_[k + 1].entry_squared : 0.0;
    leave_squared = std::min(leave_squared, entry_squared + 2 * s.acceleration * s.length);
    durations_.push_back(trapezoid(s.length, std::sqrt(entry_squared), std::sqrt(leave_squared),
                                   s.speed, s.acceleration));
    seconds_ += durations_.back();
    entry_squared = leave_squared;
  }
  pending_.clear();
}

void TimeModel::turn(double tilt_rad, double c_rad) {
  rest();
  const auto time = [](double angle, const RotaryAxis& axis) {
    const double way = std::fabs(angle);
    return way > 0 ? trapezoid(way, 0, 0, axis.rapid_rad_per_s, axis.acceleration_rad_per_s2) : 0.0;
  };
  seconds_ += std::max(time(tilt_rad, rig_.tilt), time(c_rad, rig_.c));
}

void TimeModel::dwell(double seconds) {
  rest();
  seconds_ += seconds;
}

double TimeModel::seconds() {
  rest();
  return seconds_;
}

}  // namespace reforge::verify

// How long the machine takes: trapezoidal motion within the rig's limits, looking ahead.
//
// Each move runs at its feed (or the axes' rapids), each axis within its own speed and
// acceleration; corners are passed at the speed a junction deviation of 0.01 mm allows. Barriers
// (dwell, M-codes, spindle, rotary moves, the end) bring the machine to rest. Look-ahead ends after
// 1024 moves, where the machine is taken to stop. Seconds. Not counted: heating up, the sending of
// lines.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "protocols/rig.h"

namespace reforge::verify {

class TimeModel {
 public:
  explicit TimeModel(const RigDescription& rig) : rig_(rig) {}

  // A straight move of the linear axes, mm; without a feed at the rapids.
  void move(const std::array<double, 3>& delta_mm, std::optional<double> feed_mm_per_s);
  // Rotary axes alone, radians.
  void turn(double tilt_rad, double c_rad);
  void dwell(double seconds);  // comes to rest first; 0 is a mere barrier

  double seconds();  // so far, at rest

  // Durations of the moves that came to their end since the last call, in order.
  const std::vector<double>& durations() const { return durations_; }
  void forget_durations() { durations_.clear(); }

 private:
  struct Segment {
    double length;
    double speed;  // at most
    double acceleration;
    double entry_squared;  // at most, by the corner before it
    std::array<double, 3> unit;
  };
  void rest();

  const RigDescription& rig_;
  std::vector<Segment> pending_;
  std::vector<double> durations_;
  double seconds_ = 0;
};

}  // namespace reforge::verify

// A polyline walked by its length.
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>

#include <vector>

namespace reforge {

// Point is Eigen's Vector2d or Vector3d.
template <typename Point>
class ArcLength {
 public:
  ArcLength(const std::vector<Point>& line, bool closed) : points_(line), closed_(closed) {
    assert(!line.empty());
    if (closed) points_.push_back(line.front());
    at_.assign(points_.size(), 0);
    for (size_t i = 1; i < points_.size(); ++i) {
      at_[i] = at_[i - 1] + (points_[i] - points_[i - 1]).norm();
    }
  }

  double length() const { return at_.back(); }

  // Closed lines wrap; open ones are clamped to their ends.
  Point at(double s) const {
    const double total = length();
    if (total <= 0) return points_.front();
    s = closed_ ? s - total * std::floor(s / total) : std::clamp(s, 0.0, total);
    const auto after = std::upper_bound(at_.begin(), at_.end(), s) - at_.begin();
    const size_t i = std::clamp<size_t>(static_cast<size_t>(after), 1, points_.size() - 1);
    const double piece = at_[i] - at_[i - 1];
    const double t = piece > 0 ? (s - at_[i - 1]) / piece : 0;
    return Point(points_[i - 1] + t * (points_[i] - points_[i - 1]));
  }

  // Back and forth on an open line, round and round (backwards) on a closed one, ending at its
  // start for t = 0: the way a ramp comes in.
  Point before_start(double t) const {
    if (closed_) return at(-t);
    const double total = length();
    if (total <= 0) return points_.front();
    const double folded = std::fmod(t + total, 2 * total);
    return at(std::abs(folded - total));
  }

 private:
  std::vector<Point> points_;
  std::vector<double> at_;
  bool closed_;
};

}  // namespace reforge

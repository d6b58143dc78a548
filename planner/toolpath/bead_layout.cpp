#include "planner/toolpath/bead_layout.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "planner/toolpath/arc_length.h"

namespace reforge {
namespace {

constexpr double kTwoBeadsFrom =
    0.8;                             // of a bead's width: half of the narrowest rib with two beads
constexpr double kTolerance = 0.01;  // mm, of a bead's line
constexpr double kShortestBead = 0.4;  // mm
constexpr double kOverlap = 0.1;       // mm that infill reaches into the innermost wall
constexpr double kSmallestFill = 0.2;  // mm^2

// The line in the middle of a narrow piece: between its two ends, half way from side to side.
Bead middle_line(const PlaneRegion& piece, double width) {
  const Polyline& outer = piece.rings.front();
  if (piece.rings.size() > 1) {
    // A narrow ring: its outer contour moved in by half the ring's thickness.
    double around = 0;
    for (const Polyline& ring : piece.rings) around += length_of(ring, true);
    const PlaneRegion moved = offset({{outer}}, -area(piece) / around);
    if (!moved.rings.empty()) return {simplified(moved.rings.front(), kTolerance, true), true};
  }
  size_t end_a = 0, end_b = 0;
  double farthest = -1;
  for (size_t i = 0; i < outer.size(); ++i) {
    for (size_t j = i + 1; j < outer.size(); ++j) {
      const double d = (outer[i] - outer[j]).squaredNorm();
      if (d > farthest) {
        farthest = d;
        end_a = i;
        end_b = j;
      }
    }
  }
  Polyline there(outer.begin() + static_cast<std::ptrdiff_t>(end_a),
                 outer.begin() + static_cast<std::ptrdiff_t>(end_b) + 1);
  Polyline back(outer.begin() + static_cast<std::ptrdiff_t>(end_b), outer.end());
  back.insert(back.end(), outer.begin(), outer.begin() + static_cast<std::ptrdiff_t>(end_a) + 1);
  std::reverse(back.begin(), back.end());
  const ArcLength<Vec2> one(there, false), other(back, false);
  const double length = (one.length() + other.length()) / 2;
  const int steps = std::max(2, static_cast<int>(std::ceil(length / 0.2)));
  // The bead's round ends reach half a width on.
  const double trim = std::min(width / 2, 0.3 * length) / length;
  Polyline line;
  for (int i = 0; i <= steps; ++i) {
    const double t = trim + (1 - 2 * trim) * i / steps;
    line.push_back((one.at(t * one.length()) + other.at(t * other.length())) / 2);
  }
  return {simplified(line, kTolerance, false), false};
}

struct Filling {
  std::vector<Bead> beads;
  double length = 0;
};

// Back and forth at 45 or 135 degrees, neighbouring lines joined where the way between them is
// inside.
Filling zigzag(const PlaneRegion& region, bool turned, double spacing) {
  Filling filling;
  const double angle = (turned ? 3 : 1) * std::numbers::pi / 4;
  const Vec2 along(std::cos(angle), std::sin(angle)), across(-along.y(), along.x());
  double low = 1e300, high = -1e300, left = 1e300, right = -1e300;
  for (const Polyline& ring : region.rings) {
    for (const Vec2& p : ring) {
      low = std::min(low, across.dot(p));
      high = std::max(high, across.dot(p));
      left = std::min(left, along.dot(p));
      right = std::max(right, along.dot(p));
    }
  }
  const PlaneRegion room = offset(region, 2 * kOverlap);
  struct Stroke {
    Vec2 from, to;
    bool used = false;
  };
  std::vector<std::vector<Stroke>> rows;
  // Lines stand at whole multiples of the spacing, so that every second layer's meet.
  for (double k = std::ceil(low / spacing); k * spacing < high; ++k) {
    const Vec2 foot = across * (k * spacing);
    rows.emplace_back();
    for (const Polyline& piece :
         inside({{foot + along * (left - 1), foot + along * (right + 1)}}, region)) {
      rows.back().push_back({piece.front(), piece.back()});
    }
  }
  const auto free_between = [&](const Vec2& a, const Vec2& b) {
    const int steps = std::max(2, static_cast<int>(std::ceil((b - a).norm() / 0.2)));
    for (int i = 1; i < steps; ++i) {
      if (!contains(room, a + (b - a) * (static_cast<double>(i) / steps))) return false;
    }
    return true;
  };
  for (size_t row = 0; row < rows.size(); ++row) {
    for (Stroke& start : rows[row]) {
      if (start.used) continue;
      start.used = true;
      Polyline line{start.from, start.to};
      bool grown = true;
      for (size_t r = row + 1; grown && r < rows.size(); ++r) {
        grown = false;
        for (Stroke& next : rows[r]) {
          if (next.used) continue;
          const double to_from = (next.from - line.back()).norm(),
                       to_to = (next.to - line.back()).norm();
          const Vec2 near = to_from < to_to ? next.from : next.to;
          const Vec2 far = to_from < to_to ? next.to : next.from;
          if (std::min(to_from, to_to) > 2.5 * spacing || !free_between(line.back(), near))
            continue;
          next.used = true;
          line.push_back(near);
          line.push_back(far);
          grown = true;
          break;
        }
      }
      const double length = length_of(line, false);
      if (length < kShortestBead) continue;
      filling.length += length;
      filling.beads.push_back({std::move(line), false});
    }
  }
  return filling;
}

// Strokes whose length, links included, is `share` of what would fill the region wholly.
void fill(const PlaneRegion& nominal, const PlaneRegion& region, bool turned, double share,
          double width, std::vector<Bead>& out) {
  const double wanted = share * area(nominal) / width;
  if (area(nominal) < kSmallestFill) return;
  double spacing = width / share;
  Filling best = zigzag(region, turned, spacing);
  for (int i = 0; i < 2 && best.length > 1.02 * wanted; ++i) {
    spacing *= std::min(1.5, best.length / wanted);
    if (spacing > 1.6 * width / share)
      break;  // more would leave too wide a bridge for what lies above
    best = zigzag(region, turned, spacing);
  }
  for (Bead& bead : best.beads) out.push_back(std::move(bead));
}

}  // namespace

std::vector<Bead> lay_beads(const PlaneRegion& layer, const PlaneRegion& solid, bool turned,
                            const BeadOptions& options) {
  const double w = options.width_mm;
  std::vector<Bead> beads;
  const PlaneRegion wide =
      common(offset(offset(layer, -kTwoBeadsFrom * w), kTwoBeadsFrom * w + 0.01), layer);
  const PlaneRegion narrow = offset(offset(without(layer, wide), -0.02), 0.02);
  for (const PlaneRegion& island : islands(wide)) {
    std::vector<std::vector<Bead>> walls;
    for (int k = 0; k < options.walls; ++k) {
      const PlaneRegion centre = offset(island, -(k + 0.5) * w);
      if (centre.empty()) break;
      walls.emplace_back();
      for (const Polyline& ring : centre.rings) {
        Polyline line = simplified(ring, kTolerance, true);
        if (line.size() > 2 && length_of(line, true) > kShortestBead) {
          walls.back().push_back({std::move(line), true});
        }
      }
    }
    std::reverse(walls.begin(), walls.end());
    for (std::vector<Bead>& wall : walls) {
      for (Bead& bead : wall) beads.push_back(std::move(bead));
    }
    const PlaneRegion interior = offset(island, -options.walls * w);
    const PlaneRegion room = offset(interior, kOverlap);
    const PlaneRegion whole = common(interior, solid);
    fill(whole, common(offset(whole, kOverlap), room), turned, 1, w, beads);
    const PlaneRegion sparse = offset(offset(without(interior, solid), -0.1), 0.1);
    fill(sparse, common(offset(sparse, kOverlap), room), turned, options.infill, w, beads);
  }
  for (const PlaneRegion& piece : islands(narrow)) {
    if (area(piece) < 0.05) continue;
    Bead bead = middle_line(piece, w);
    if (length_of(bead.line, bead.closed) >= kShortestBead) beads.push_back(std::move(bead));
  }
  return beads;
}

}  // namespace reforge

#include "planner/toolpath/bead_cover.h"

#include <algorithm>
#include <cmath>

#include "planner/toolpath/arc_length.h"

namespace reforge {
namespace {

constexpr double kPitch = 0.1;
constexpr double kStep = 0.25;         // mm along a bead between places asked
constexpr int kAcross = 9;             // points across its width
constexpr int kEnough = 3;             // of them carried
constexpr double kShortestBead = 0.5;  // mm of a stretch worth printing

}  // namespace

BeadCover::BeadCover(const Vec2& low, const Vec2& high)
    : origin_(low - Vec2(1, 1)),
      columns_(static_cast<int>((high.x() - low.x() + 2) / kPitch) + 1),
      rows_(static_cast<int>((high.y() - low.y() + 2) / kPitch) + 1),
      cells_(static_cast<size_t>(columns_) * rows_, 0) {}

void BeadCover::stamp(const Bead& bead, double width) {
  const ArcLength<Vec2> walk(bead.line, bead.closed);
  const int steps = std::max(1, static_cast<int>(std::ceil(walk.length() / kPitch)));
  const int reach = static_cast<int>(std::ceil(width / 2 / kPitch));
  for (int i = 0; i <= steps; ++i) {
    const Vec2 p = (walk.at(walk.length() * i / steps) - origin_) / kPitch;
    const int c0 = static_cast<int>(std::lround(p.x())), r0 = static_cast<int>(std::lround(p.y()));
    for (int r = std::max(0, r0 - reach); r <= std::min(rows_ - 1, r0 + reach); ++r) {
      for (int c = std::max(0, c0 - reach); c <= std::min(columns_ - 1, c0 + reach); ++c) {
        if (std::hypot(c - p.x(), r - p.y()) * kPitch <= width / 2) {
          cells_[static_cast<size_t>(r) * columns_ + c] = 1;
        }
      }
    }
  }
}

bool BeadCover::covered(const Vec2& p) const {
  const Vec2 d = (p - origin_) / kPitch;
  const int c = static_cast<int>(std::lround(d.x())), r = static_cast<int>(std::lround(d.y()));
  return c >= 0 && r >= 0 && c < columns_ && r < rows_ &&
         cells_[static_cast<size_t>(r) * columns_ + c] != 0;
}

std::vector<Bead> carried_parts(const Bead& bead, double width, double bridge_mm,
                                const std::function<bool(const Vec2&)>& carries, double& lost_mm) {
  const ArcLength<Vec2> walk(bead.line, bead.closed);
  const double total = walk.length();
  const int count = std::max(2, static_cast<int>(std::ceil(total / kStep)));
  std::vector<char> lies(static_cast<size_t>(count) + 1, 0);
  for (int i = 0; i <= count; ++i) {
    const double s = total * i / count;
    const Vec2 p = walk.at(s);
    Vec2 along = walk.at(std::min(s + 0.02, total)) - walk.at(std::max(s - 0.02, 0.0));
    if (along.norm() < 1e-9) along = Vec2::UnitX();
    const Vec2 across = Vec2(-along.y(), along.x()).normalized() * width;
    int on = 0;
    for (int k = 0; k < kAcross; ++k) on += carries(p + across * ((k + 0.5) / kAcross - 0.5));
    lies[static_cast<size_t>(i)] = on >= kEnough;
  }
  // Stretches that hang for longer than a bridge go. A bead's ends, a ring's too, may hang for half
  // of one: where two of them meet they make no more than a bridge.
  std::vector<std::pair<int, int>> kept;  // [from, to]
  int from = 0;
  bool whole = true;
  for (int i = 0; i <= count;) {
    if (lies[static_cast<size_t>(i)]) {
      ++i;
      continue;
    }
    int end = i;
    while (end <= count && !lies[static_cast<size_t>(end)]) ++end;
    const double length = total * (end - i) / count;
    const bool at_end = i == 0 || end > count;
    if (length > (at_end ? bridge_mm / 2 : bridge_mm)) {
      whole = false;
      if (i > from) kept.emplace_back(from, i);
      from = end;
    }
    i = end;
  }
  if (whole) return {bead};
  if (from < count) kept.emplace_back(from, count);
  std::vector<Bead> parts;
  double left = 0;
  for (const auto& [a, b] : kept) {
    Polyline line;
    for (int i = a; i <= std::min(b, count); ++i)
      line.push_back(walk.at(std::min(total * i / count, total * (1 - 1e-9))));
    line = simplified(line, 0.01, false);
    if (line.size() < 2 || length_of(line, false) < kShortestBead) continue;
    left += length_of(line, false);
    parts.push_back({std::move(line), false});
  }
  lost_mm += total - left;
  return parts;
}

}  // namespace reforge

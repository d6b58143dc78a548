#include "planner/verify/layers.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace reforge::verify {
namespace {

constexpr float kInf = std::numeric_limits<float>::infinity();
// Deposits closer than this along a line are one: neighbouring cells of one bead.
constexpr float kMergeGap = 1e-3f;
// Steeper than this between neighbouring cells stands a wall, somewhere between their centres: each
// cell then speaks for itself. Bilinear, the wall would always stand at the higher cell's centre.
constexpr float kWall = 6.0f;

}  // namespace

void CellRect::include(const CellRect& other) {
  if (other.empty()) return;
  if (empty()) {
    *this = other;
    return;
  }
  i0 = std::min(i0, other.i0), j0 = std::min(j0, other.j0);
  i1 = std::max(i1, other.i1), j1 = std::max(j1, other.j1);
}

BoundsPyramid::BoundsPyramid(const std::vector<float>& low, const std::vector<float>& high,
                             int width, int height) {
  Level base{width, height, {}};
  base.nodes.reserve(low.size());
  for (std::size_t c = 0; c < low.size(); ++c) base.nodes.push_back({low[c], high[c]});
  levels_.push_back(std::move(base));
  while (levels_.back().width > 1 || levels_.back().height > 1) {
    const Level& fine = levels_.back();
    Level coarse{(fine.width + 1) / 2, (fine.height + 1) / 2, {}};
    coarse.nodes.reserve(static_cast<std::size_t>(coarse.width) *
                         static_cast<std::size_t>(coarse.height));
    for (int j = 0; j < coarse.height; ++j) {
      for (int i = 0; i < coarse.width; ++i) {
        Range range{kInf, -kInf};
        for (int b = 2 * j; b < std::min(2 * j + 2, fine.height); ++b) {
          for (int a = 2 * i; a < std::min(2 * i + 2, fine.width); ++a) {
            const Range& r = fine.nodes[static_cast<std::size_t>(b) * fine.width + a];
            range.low = std::min(range.low, r.low);
            range.high = std::max(range.high, r.high);
          }
        }
        coarse.nodes.push_back(range);
      }
    }
    levels_.push_back(std::move(coarse));
  }
}

BoundsPyramid::Range BoundsPyramid::over(int i0, int j0, int i1, int j1) const {
  std::size_t level = 0;
  const int extent = std::max(i1 - i0, j1 - j0);
  while (level + 1 < levels_.size() && (extent >> level) > 1) ++level;
  const Level& nodes = levels_[level];
  const int shift = static_cast<int>(level);
  Range range{kInf, -kInf};
  for (int j = j0 >> shift; j <= j1 >> shift; ++j) {
    for (int i = i0 >> shift; i <= i1 >> shift; ++i) {
      const Range& r = nodes.nodes[static_cast<std::size_t>(j) * nodes.width + i];
      range.low = std::min(range.low, r.low);
      range.high = std::max(range.high, r.high);
    }
  }
  return range;
}

namespace {

// The piece of [t0, t1] whose x and y stay in [0, width-1] x [0, height-1], widened by `slack`
// cells.
bool clip(const LayerLine& line, const CellRect& rect, double slack, double& t0, double& t1) {
  const auto slab = [&](double at, double slope, double lo, double hi) {
    if (slope == 0) return at >= lo && at <= hi;
    double a = (lo - at) / slope;
    double b = (hi - at) / slope;
    if (a > b) std::swap(a, b);
    t0 = std::max(t0, a);
    t1 = std::min(t1, b);
    return t0 < t1;
  };
  return slab(line.x, line.dx, -slack, rect.width() - 1 + slack) &&
         slab(line.y, line.dy, -slack, rect.height() - 1 + slack) && t0 < t1;
}

struct CellBox {
  int i0, j0, i1, j1;
};

CellBox cells_of(const LayerLine& line, double t0, double t1, const CellRect& rect) {
  double xa = line.x + t0 * line.dx, xb = line.x + t1 * line.dx;
  double ya = line.y + t0 * line.dy, yb = line.y + t1 * line.dy;
  if (xa > xb) std::swap(xa, xb);
  if (ya > yb) std::swap(ya, yb);
  const auto low = [](double x, int n) {
    return std::clamp(static_cast<int>(std::floor(x)), 0, n - 1);
  };
  const auto high = [](double x, int n) {
    return std::clamp(static_cast<int>(std::floor(x)) + 1, 0, n - 1);
  };
  return {low(xa, rect.width()), low(ya, rect.height()), high(xb, rect.width()),
          high(yb, rect.height())};
}

void append(Intervals& out, double t0, double t1) {
  const auto lo = static_cast<float>(t0);
  const auto hi = static_cast<float>(t1);
  if (!(hi > lo)) return;
  if (!out.empty() && lo <= out.back().hi) {
    out.back().hi = std::max(out.back().hi, hi);
  } else {
    out.push_back({lo, hi});
  }
}

}  // namespace

CutLayer::CutLayer(const View& view, const CellRect& rect,
                   const std::vector<float>& surface_of_view)
    : view_(view), rect_(rect) {
  surface_.reserve(static_cast<std::size_t>(rect.width()) *
                   static_cast<std::size_t>(rect.height()));
  for (int j = rect.j0; j < rect.j1; ++j) {
    for (int i = rect.i0; i < rect.i1; ++i) surface_.push_back(surface_of_view[view.cell(i, j)]);
  }
  bounds_ = BoundsPyramid(surface_, surface_, rect.width(), rect.height());
}

std::size_t CutLayer::bytes() const {
  return surface_.size() * 4 * sizeof(float);
}

double CutLayer::surface(double x, double y) const {
  const int w = rect_.width();
  const int h = rect_.height();
  const auto value = [&](int i, int j) {
    if (i < 0 || j < 0 || i >= w || j >= h) return kInf;
    return surface_[static_cast<std::size_t>(j) * w + i];
  };
  const int i = static_cast<int>(std::floor(x));
  const int j = static_cast<int>(std::floor(y));
  const double fx = x - i;
  const double fy = y - j;
  const float a = value(i, j), b = value(i + 1, j), c = value(i, j + 1), d = value(i + 1, j + 1);
  const auto [low, high] = std::minmax({a, b, c, d});
  if (high - low > kWall * static_cast<float>(view_.pitch) || high == kInf) {
    const float nearest = fy < 0.5 ? (fx < 0.5 ? a : b) : (fx < 0.5 ? c : d);
    return static_cast<double>(nearest);
  }
  return (1 - fy) * ((1 - fx) * a + fx * b) + fy * ((1 - fx) * c + fx * d);
}

void CutLayer::removed_on(const LayerLine& line, double t0, double t1, Intervals& removed) const {
  if (rect_.empty() || !clip(line, rect_, 0.5, t0, t1)) return;
  const auto f = [&](double t) {
    return line.w + t * line.dw - surface(line.x + t * line.dx, line.y + t * line.dy);
  };
  const double cells_per_mm = std::max(std::fabs(line.dx), std::fabs(line.dy));
  // Depth first, left to right: the pieces come out in ascending order.
  const auto walk = [&](const auto& self, double a, double b) -> void {
    const CellBox box = cells_of(line, a, b, rect_);
    const BoundsPyramid::Range range = bounds_.over(box.i0, box.j0, box.i1, box.j1);
    const double wa = line.w + a * line.dw;
    const double wb = line.w + b * line.dw;
    if (std::max(wa, wb) <= range.low) return;
    if (std::min(wa, wb) > range.high) return append(removed, a, b);
    if ((b - a) * cells_per_mm > 1.0) {
      const double middle = 0.5 * (a + b);
      self(self, a, middle);
      self(self, middle, b);
      return;
    }
    const double fa = f(a);
    const double fb = f(b);
    if (fa <= 0 && fb <= 0) return;
    if (fa > 0 && fb > 0) return append(removed, a, b);
    const bool finite = std::isfinite(fa) && std::isfinite(fb);
    const double root = finite ? a + (b - a) * fa / (fa - fb) : 0.5 * (a + b);
    if (fa > 0) {
      append(removed, a, root);
    } else {
      append(removed, root, b);
    }
  };
  walk(walk, t0, t1);
}

DepositLayer::DepositLayer(const View& view, const CellRect& rect, Columns columns)
    : view_(view), rect_(rect), columns_(std::move(columns)) {
  std::vector<float> low(columns_.size(), kInf);
  std::vector<float> high(columns_.size(), -kInf);
  for (std::size_t c = 0; c < columns_.size(); ++c) {
    const auto column = columns_.at(c);
    if (column.empty()) continue;
    low[c] = column.front().lo;
    high[c] = column.back().hi;
  }
  bounds_ = BoundsPyramid(low, high, rect.width(), rect.height());
}

std::size_t DepositLayer::bytes() const {
  return columns_.intervals() * sizeof(Interval) + columns_.size() * 5 * sizeof(float);
}

void DepositLayer::add_in_cell(const LayerLine& line, double t0, double t1,
                               Intervals& deposited) const {
  const double middle = 0.5 * (t0 + t1);
  const int i = static_cast<int>(std::lround(line.x + middle * line.dx));
  const int j = static_cast<int>(std::lround(line.y + middle * line.dy));
  if (i < 0 || j < 0 || i >= rect_.width() || j >= rect_.height()) return;
  for (const Interval& bead : columns_.at(static_cast<std::size_t>(j) * rect_.width() + i)) {
    double a = t0;
    double b = t1;
    const double lo = static_cast<double>(bead.lo);
    const double hi = static_cast<double>(bead.hi);
    if (std::fabs(line.dw) < 1e-12) {
      if (line.w <= lo || line.w > hi) continue;
    } else {
      double p = (lo - line.w) / line.dw;
      double q = (hi - line.w) / line.dw;
      if (p > q) std::swap(p, q);
      a = std::max(a, p);
      b = std::min(b, q);
    }
    const Interval piece{static_cast<float>(a), static_cast<float>(b)};
    if (piece.hi > piece.lo) unite(deposited, piece, kMergeGap);
  }
}

void DepositLayer::added_on(const LayerLine& line, double t0, double t1,
                            Intervals& deposited) const {
  if (rect_.empty() || !clip(line, rect_, 0.5, t0, t1)) return;
  const double cells_per_mm = std::max(std::fabs(line.dx), std::fabs(line.dy));
  const auto walk = [&](const auto& self, double a, double b) -> void {
    const CellBox box = cells_of(line, a, b, rect_);
    const BoundsPyramid::Range range = bounds_.over(box.i0, box.j0, box.i1, box.j1);
    const double wa = line.w + a * line.dw;
    const double wb = line.w + b * line.dw;
    if (std::max(wa, wb) < range.low || std::min(wa, wb) > range.high) return;
    if ((b - a) * cells_per_mm > 1.0) {
      const double middle = 0.5 * (a + b);
      self(self, a, middle);
      self(self, middle, b);
      return;
    }
    add_in_cell(line, a, b, deposited);
  };
  walk(walk, t0, t1);
}

}  // namespace reforge::verify

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
  const auto half = [](int n) { return (n + 1) / 2; };
  Level base{half(width), half(height), {}};
  base.nodes.assign(static_cast<std::size_t>(base.width) * static_cast<std::size_t>(base.height),
                    Range{kInf, -kInf});
  for (int j = 0; j < height; ++j) {
    for (int i = 0; i < width; ++i) {
      const std::size_t cell = static_cast<std::size_t>(j) * width + i;
      Range& range = base.nodes[static_cast<std::size_t>(j / 2) * base.width + i / 2];
      range.low = std::min(range.low, low[cell]);
      range.high = std::max(range.high, high[cell]);
    }
  }
  levels_.push_back(std::move(base));
  while (levels_.back().width > 1 || levels_.back().height > 1) {
    const Level& fine = levels_.back();
    Level coarse{half(fine.width), half(fine.height), {}};
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

std::size_t BoundsPyramid::bytes() const {
  std::size_t sum = 0;
  for (const Level& level : levels_) sum += level.nodes.size() * sizeof(Range);
  return sum;
}

BoundsPyramid::Range BoundsPyramid::over(int i0, int j0, int i1, int j1) const {
  std::size_t level = 0;
  const int extent = std::max(i1 - i0, j1 - j0);
  while (level + 1 < levels_.size() && (extent >> (level + 1)) > 1) ++level;
  const Level& nodes = levels_[level];
  const int shift = static_cast<int>(level) + 1;
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

// Lines side by side, as one thick line: all x, y, w lie between those of `low` and `high`.
struct Bundle {
  LayerLine low, high;

  explicit Bundle(std::span<const LineStretch> lines)
      : low(lines.front().line), high(lines.front().line) {
    for (const LineStretch& s : lines) {
      low.x = std::min(low.x, s.line.x), high.x = std::max(high.x, s.line.x);
      low.y = std::min(low.y, s.line.y), high.y = std::max(high.y, s.line.y);
      low.w = std::min(low.w, s.line.w), high.w = std::max(high.w, s.line.w);
    }
  }
};

// Without floor(): in the plainest instruction set that is a call.
int lower_cell(double x, int n) {
  return static_cast<int>(std::clamp(x, 0.0, static_cast<double>(n - 1)));
}
int upper_cell(double x, int n) {
  return static_cast<int>(std::clamp(x + 1, 0.0, static_cast<double>(n - 1)));
}
int whole(double x) {
  const int cut = static_cast<int>(x);
  return x < cut ? cut - 1 : cut;
}

CellBox cells_of(const Bundle& bundle, double t0, double t1, const CellRect& rect) {
  const LayerLine& low = bundle.low;
  const LayerLine& high = bundle.high;
  const double xa = t0 * low.dx, xb = t1 * low.dx;
  const double ya = t0 * low.dy, yb = t1 * low.dy;
  return {lower_cell(low.x + std::min(xa, xb), rect.width()),
          lower_cell(low.y + std::min(ya, yb), rect.height()),
          upper_cell(high.x + std::max(xa, xb), rect.width()),
          upper_cell(high.y + std::max(ya, yb), rect.height())};
}

double cells_per_mm(const LayerLine& line) {
  return std::max(std::fabs(line.dx), std::fabs(line.dy));
}

enum class Met { kNothing, kAll, kSome };

// Depth first, left to right, so that pieces come out in ascending order. judge(range, low, high)
// holds the bounds of the layer against the heights of the piece; all(a, b) takes a piece that is
// met whole, some(a, b) one that is met in part and is at most `cells` long.
template <typename Judge, typename All, typename Some>
void walk(const Bundle& bundle, const CellRect& rect, const BoundsPyramid& bounds, double a,
          double b, double cells, const Judge& judge, const All& all, const Some& some) {
  const CellBox box = cells_of(bundle, a, b, rect);
  const BoundsPyramid::Range range = bounds.over(box.i0, box.j0, box.i1, box.j1);
  const double wa = a * bundle.low.dw, wb = b * bundle.low.dw;
  const Met met = judge(range, bundle.low.w + std::min(wa, wb), bundle.high.w + std::max(wa, wb));
  if (met == Met::kNothing) return;
  if (met == Met::kAll) return all(a, b);
  if ((b - a) * cells_per_mm(bundle.low) > cells) {
    const double middle = 0.5 * (a + b);
    walk(bundle, rect, bounds, a, middle, cells, judge, all, some);
    walk(bundle, rect, bounds, middle, b, cells, judge, all, some);
    return;
  }
  some(a, b);
}

constexpr double kBundleCells = 8;  // long pieces are looked at for all lines at once

// The stretches within the layer's rectangle, with the numbers of their lines.
struct Clipped {
  std::vector<LineStretch> lines;
  std::vector<std::size_t> number;
  double t0 = std::numeric_limits<double>::infinity(), t1 = -t0;

  Clipped(std::span<const LineStretch> asked, const CellRect& rect) {
    for (std::size_t k = 0; k < asked.size(); ++k) {
      LineStretch s = asked[k];
      if (!(s.t0 < s.t1) || !clip(s.line, rect, 0.5, s.t0, s.t1)) continue;
      lines.push_back(s);
      number.push_back(k);
      t0 = std::min(t0, s.t0);
      t1 = std::max(t1, s.t1);
    }
  }
};

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
  return surface_.size() * sizeof(float) + bounds_.bytes();
}

double CutLayer::surface(double x, double y) const {
  const int w = rect_.width();
  const int h = rect_.height();
  const auto value = [&](int i, int j) {
    if (i < 0 || j < 0 || i >= w || j >= h) return kInf;
    return surface_[static_cast<std::size_t>(j) * w + i];
  };
  const int i = whole(x);
  const int j = whole(y);
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

void CutLayer::removed_on(std::span<const LineStretch> asked, std::span<Intervals> removed) const {
  if (rect_.empty()) return;
  const Clipped clipped(asked, rect_);
  if (clipped.lines.empty()) return;
  const auto judge = [](const BoundsPyramid::Range& range, double low, double high) {
    if (high <= static_cast<double>(range.low)) return Met::kNothing;
    return low > static_cast<double>(range.high) ? Met::kAll : Met::kSome;
  };
  const auto one_line = [&](const LineStretch& s, Intervals& out, double t0, double t1) {
    const LayerLine& line = s.line;
    const auto all = [&](double a, double b) { append(out, a, b); };
    const auto some = [&](double a, double b) {
      const auto above = [&](double t) {
        return line.w + t * line.dw - surface(line.x + t * line.dx, line.y + t * line.dy);
      };
      const double fa = above(a);
      const double fb = above(b);
      if (fa <= 0 && fb <= 0) return;
      if (fa > 0 && fb > 0) return append(out, a, b);
      const bool finite = std::isfinite(fa) && std::isfinite(fb);
      const double root = finite ? a + (b - a) * fa / (fa - fb) : 0.5 * (a + b);
      if (fa > 0) {
        append(out, a, root);
      } else {
        append(out, root, b);
      }
    };
    walk(Bundle({&s, 1}), rect_, bounds_, t0, t1, 1.0, judge, all, some);
  };
  const auto each = [&](double a, double b, const auto& take) {
    for (std::size_t k = 0; k < clipped.lines.size(); ++k) {
      const LineStretch& s = clipped.lines[k];
      const double t0 = std::max(a, s.t0), t1 = std::min(b, s.t1);
      if (t0 < t1) take(s, removed[clipped.number[k]], t0, t1);
    }
  };
  walk(
      Bundle(clipped.lines), rect_, bounds_, clipped.t0, clipped.t1, kBundleCells, judge,
      [&](double a, double b) {
        each(a, b,
             [](const LineStretch&, Intervals& out, double t0, double t1) { append(out, t0, t1); });
      },
      [&](double a, double b) { each(a, b, one_line); });
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
  return columns_.intervals() * sizeof(Interval) + columns_.size() * sizeof(std::uint32_t) +
         bounds_.bytes();
}

void DepositLayer::add_in_cell(const LayerLine& line, double t0, double t1,
                               Intervals& deposited) const {
  const double middle = 0.5 * (t0 + t1);
  const int i = whole(line.x + middle * line.dx + 0.5);
  const int j = whole(line.y + middle * line.dy + 0.5);
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

void DepositLayer::added_on(std::span<const LineStretch> asked,
                            std::span<Intervals> deposited) const {
  if (rect_.empty()) return;
  const Clipped clipped(asked, rect_);
  if (clipped.lines.empty()) return;
  const auto judge = [](const BoundsPyramid::Range& range, double low, double high) {
    const bool beside =
        high < static_cast<double>(range.low) || low > static_cast<double>(range.high);
    return beside ? Met::kNothing : Met::kSome;
  };
  const auto never = [](double, double) {};
  walk(Bundle(clipped.lines), rect_, bounds_, clipped.t0, clipped.t1, kBundleCells, judge, never,
       [&](double a, double b) {
         for (std::size_t k = 0; k < clipped.lines.size(); ++k) {
           const LineStretch& s = clipped.lines[k];
           const double t0 = std::max(a, s.t0), t1 = std::min(b, s.t1);
           if (!(t0 < t1)) continue;
           Intervals& out = deposited[clipped.number[k]];
           walk(Bundle({&s, 1}), rect_, bounds_, t0, t1, 1.0, judge, never,
                [&](double p, double q) { add_in_cell(s.line, p, q, out); });
         }
       });
}

}  // namespace reforge::verify

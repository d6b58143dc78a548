#include "planner/verify/block_stock.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "planner/verify/ball_sweep.h"

namespace reforge::verify {
namespace {

constexpr float kInf = std::numeric_limits<float>::infinity();

// A row of columns under a disc that moves from a to b.
class Capsule {
 public:
  Capsule(const View& view, const Vec3& a, const Vec3& b, double radius)
      : view_(view), ax_(a.x()), ay_(a.y()), bx_(b.x()), by_(b.y()), r_(radius) {
    const double length = std::hypot(bx_ - ax_, by_ - ay_);
    if (length > 0) {
      nx_ = -(by_ - ay_) / length * r_;
      ny_ = (bx_ - ax_) / length * r_;
    }
  }
  // Rows that may be touched, [first, second), before clipping to the grid.
  int first_row() const { return cell(std::min(ay_, by_) - r_, view_.v0); }
  int end_row() const { return cell(std::max(ay_, by_) + r_, view_.v0) + 1; }

  // Cells [i0, i1) of the row whose centres are under the capsule (one more at each end at most).
  bool span(int j, int& i0, int& i1) const {
    const double y = view_.v(j);
    double lo = std::numeric_limits<double>::infinity(), hi = -lo;
    disc(ax_, ay_, y, lo, hi);
    disc(bx_, by_, y, lo, hi);
    edge(ax_ + nx_, ay_ + ny_, bx_ + nx_, by_ + ny_, y, lo, hi);
    edge(ax_ - nx_, ay_ - ny_, bx_ - nx_, by_ - ny_, y, lo, hi);
    if (lo > hi) return false;
    i0 = cell(lo, view_.u0);
    i1 = cell(hi, view_.u0) + 1;
    return true;
  }

 private:
  int cell(double x, double origin) const {
    // Without floor(): in the plainest instruction set that is a call.
    constexpr double kFar = 1e6;
    return static_cast<int>(std::clamp((x - origin) / view_.pitch, -kFar, kFar) + kFar) -
           static_cast<int>(kFar);
  }
  void disc(double cx, double cy, double y, double& lo, double& hi) const {
    const double h = r_ * r_ - (y - cy) * (y - cy);
    if (h < 0) return;
    lo = std::min(lo, cx - std::sqrt(h));
    hi = std::max(hi, cx + std::sqrt(h));
  }
  static void edge(double x0, double y0, double x1, double y1, double y, double& lo, double& hi) {
    if (y0 == y1 || y < std::min(y0, y1) || y > std::max(y0, y1)) return;
    const double x = x0 + (x1 - x0) * (y - y0) / (y1 - y0);
    lo = std::min(lo, x);
    hi = std::max(hi, x);
  }

  const View& view_;
  double ax_, ay_, bx_, by_, r_;
  double nx_ = 0, ny_ = 0;
};

float highest_below(std::span<const Interval> column, float limit) {
  for (std::size_t k = column.size(); k-- > 0;) {
    if (column[k].lo < limit) return std::min(column[k].hi, limit);
  }
  return -kInf;
}

std::vector<float> tops(const Material& material) {
  std::vector<float> top(material.original.size());
  for (std::size_t c = 0; c < top.size(); ++c) {
    top[c] = std::max(highest_below(material.original.at(c), kInf),
                      highest_below(material.deposited.at(c), kInf));
  }
  return top;
}

void clip_above(std::span<const Interval> column, float limit, Intervals& out) {
  out.clear();
  for (Interval s : column) {
    if (s.lo >= limit) break;
    s.hi = std::min(s.hi, limit);
    out.push_back(s);
  }
}

}  // namespace

BlockStock::BlockStock(const View& view, Material material)
    : envelope_(view, tops(material)),
      material_(std::move(material)),
      surface_(view.cells(), kInf),
      guard_(view.cells(), -kInf) {
  envelope_.set_exact([this](std::size_t cell) { return exact_top(cell); });
}

void BlockStock::set_guard(std::vector<float> guard) {
  assert(guard.size() == guard_.size());
  guard_ = std::move(guard);
}

float BlockStock::exact_top(std::size_t cell) const {
  const float limit = surface_[cell];
  return std::max(highest_below(material_.original.at(cell), limit),
                  highest_below(material_.deposited.at(cell), limit));
}

Gouge BlockStock::cut(const Vec3& a, const Vec3& b, double radius, double tolerance) {
  assert(deposit_rect_.empty());
  const View& grid = view();
  const Capsule capsule(grid, a, b, radius);
  const BallSweep sweep(a, b, radius);
  const int j0 = std::max(0, capsule.first_row());
  const int j1 = std::min(grid.nv, capsule.end_row());
  CellRect touched;
  float worst = kInf;
  const auto step = static_cast<float>(grid.pitch);
  for (int j = j0; j < j1; ++j) {
    int i0 = 0, i1 = 0;
    if (!capsule.span(j, i0, i1)) continue;
    i0 = std::max(i0, 0);
    i1 = std::min(i1, grid.nu);
    if (i0 >= i1) continue;
    const std::size_t cell = grid.cell(i0, j);
    worst = sweep_row(sweep, static_cast<float>(grid.u(i0) - a.x()), step,
                      static_cast<float>(grid.v(j) - a.y()), i1 - i0, surface_.data() + cell,
                      guard_.data() + cell, worst);
    touched.include({i0, j, i1, j + 1});
  }
  cut_rect_.include(touched);
  envelope_.mark_lowered(touched);
  Gouge gouge;
  if (!(static_cast<double>(worst) < -tolerance)) return gouge;
  // Rare: find the column again.
  for (int j = touched.j0; j < touched.j1; ++j) {
    for (int i = touched.i0; i < touched.i1; ++i) {
      const float keep = guard_[grid.cell(i, j)];
      if (keep == -kInf) continue;
      const double low = swept_ball_height(a, b, radius, grid.u(i), grid.v(j));
      if (static_cast<double>(keep) - low <= gouge.depth) continue;
      gouge.depth = static_cast<double>(keep) - low;
      gouge.where = Vec3(grid.u(i), grid.v(j), static_cast<double>(keep));
    }
  }
  return gouge;
}

Bead BlockStock::deposit(const Vec3& a, const Vec3& b, double width, double height) {
  assert(cut_rect_.empty());
  const View& grid = view();
  if (run_.empty()) run_.assign(grid.cells(), TopRun{kInf, -kInf, 0});
  const Capsule capsule(grid, a, b, 0.5 * width);
  Bead bead;
  const int j0 = capsule.first_row(), j1 = capsule.end_row();
  const Vec3 d = b - a;
  const double squared = d.head<2>().squaredNorm();
  const double per_squared = squared > 0 ? 1 / squared : 0;
  const double half_squared = 0.25 * width * width;
  constexpr float kTouch = 1e-3f;
  const double hair = 0.013 * grid.pitch;
  path_mm_ += d.norm();
  const auto path_mm = static_cast<float>(path_mm_);
  const auto fresh_from = static_cast<float>(path_mm_ - d.norm() - 2 * width);
  for (int j = j0; j < j1; ++j) {
    int i0 = 0, i1 = 0;
    if (!capsule.span(j, i0, i1)) continue;
    if (j < 0 || j >= grid.nv || i0 < 0 || i1 > grid.nu) bead.outside = true;
    if (j < 0 || j >= grid.nv) continue;
    i0 = std::max(i0, 0);
    i1 = std::min(i1, grid.nu);
    for (int i = i0; i < i1; ++i) {
      // Edges of beads like to lie on cell centres; by a hair's shift each such cell falls to one
      // side only, and beads keep their width.
      const double px = grid.u(i) - a.x() + hair, py = grid.v(j) - a.y() + hair;
      const double t = std::clamp((px * d.x() + py * d.y()) * per_squared, 0.0, 1.0);
      const double ex = px - t * d.x(), ey = py - t * d.y();
      if (ex * ex + ey * ey > half_squared) continue;
      const std::size_t cell = grid.cell(i, j);
      const double w = a.z() + t * d.z();
      const auto hi = static_cast<float>(w);
      const auto lo = static_cast<float>(w - height);
      const float below = envelope_.top(cell);
      TopRun& run = run_[cell];
      const bool laid =
          static_cast<double>(below) >= w - 0.7 * height;  // this layer is there already
      if (!laid || run.path_mm < fresh_from) {
        ++bead.judged;
        if (static_cast<double>(below) >= w - 1.95 * height) ++bead.supported;
      }
      if (run.hi < run.lo) {
        run = {lo, hi, path_mm};
      } else if (lo <= run.hi + kTouch && hi >= run.lo - kTouch) {
        run = {std::min(run.lo, lo), std::max(run.hi, hi), path_mm};
      } else {
        buried_.push_back({static_cast<std::uint32_t>(cell), {run.lo, run.hi}});
        run = {lo, hi, path_mm};
      }
      envelope_.raise(i, j, hi);
    }
    if (i0 < i1) deposit_rect_.include({i0, j, i1, j + 1});
  }
  return bead;
}

void BlockStock::apply_cut() {
  Material next;
  next.original.reserve(view().cells(), material_.original.intervals());
  next.deposited.reserve(view().cells(), material_.deposited.intervals());
  Intervals clipped;
  for (std::size_t c = 0; c < view().cells(); ++c) {
    clip_above(material_.original.at(c), surface_[c], clipped);
    next.original.push(clipped);
    clip_above(material_.deposited.at(c), surface_[c], clipped);
    next.deposited.push(clipped);
  }
  envelope_.mark_lowered(cut_rect_);
  material_ = std::move(next);
}

Columns BlockStock::take_deposit(const CellRect& rect) {
  std::stable_sort(buried_.begin(), buried_.end(),
                   [](const Buried& a, const Buried& b) { return a.cell < b.cell; });
  Columns layer, all;
  Intervals column, merged;
  std::size_t next = 0;
  for (int j = 0; j < view().nv; ++j) {
    for (int i = 0; i < view().nu; ++i) {
      const std::size_t cell = view().cell(i, j);
      column.clear();
      for (; next < buried_.size() && buried_[next].cell == cell; ++next) {
        unite(column, buried_[next].interval, 1e-3f);
      }
      if (run_[cell].lo <= run_[cell].hi) unite(column, {run_[cell].lo, run_[cell].hi}, 1e-3f);
      if (i >= rect.i0 && i < rect.i1 && j >= rect.j0 && j < rect.j1) layer.push(column);
      const auto old = material_.deposited.at(cell);
      merged.assign(old.begin(), old.end());
      for (const Interval& s : column) unite(merged, s, 1e-3f);
      all.push(merged);
    }
  }
  material_.deposited = std::move(all);
  buried_.clear();
  run_.clear();
  return layer;
}

void BlockStock::close(Stock& stock) {
  assert(cut_rect_.empty() || deposit_rect_.empty());
  if (!cut_rect_.empty()) {
    stock.add(CutLayer(view(), cut_rect_, surface_));
    apply_cut();
    std::fill(surface_.begin(), surface_.end(), kInf);
    envelope_.settle();
    cut_rect_ = {};
  }
  if (!deposit_rect_.empty()) {
    stock.add(DepositLayer(view(), deposit_rect_, take_deposit(deposit_rect_)));
    deposit_rect_ = {};
  }
}

}  // namespace reforge::verify

#include "planner/verify/left_over.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/verify/envelope.h"

namespace reforge::verify {
namespace {

constexpr float kNone = -std::numeric_limits<float>::infinity();
constexpr float kForbidden = 1e4f;  // tip height no tool goes below: nothing is cut there
constexpr double kCoarse = 1.0;     // mm, the holder's grid
constexpr double kWiden = 1.5;      // mm
constexpr double kLumpMin = 0.2;    // mm^3 of cells that are left over all around

// A height field over a view's grid.
using Field = std::vector<float>;

struct Offset {
  int i, j;
  float rise;  // of the ball's surface above its tip
};

std::vector<Offset> ball_offsets(double radius, double pitch) {
  std::vector<Offset> offsets;
  const int reach = static_cast<int>(std::floor(radius / pitch));
  for (int j = -reach; j <= reach; ++j) {
    for (int i = -reach; i <= reach; ++i) {
      const double squared = (i * i + j * j) * pitch * pitch;
      if (squared > radius * radius) continue;
      offsets.push_back({i, j, static_cast<float>(radius - std::sqrt(radius * radius - squared))});
    }
  }
  return offsets;
}

// result(c) = best over offsets of in(c + offset) + sign * rise.
template <typename Better>
Field sweep(const View& view, const Field& in, const std::vector<Offset>& offsets, float sign,
            float outside, Better better) {
  Field out(in.size());
  for (int j = 0; j < view.nv; ++j) {
    for (int i = 0; i < view.nu; ++i) {
      float best = in[view.cell(i, j)];
      for (const Offset& o : offsets) {
        const int a = i + o.i, b = j + o.j;
        const bool inside = a >= 0 && b >= 0 && a < view.nu && b < view.nv;
        best = better(best, (inside ? in[view.cell(a, b)] : outside) + sign * o.rise);
      }
      out[view.cell(i, j)] = best;
    }
  }
  return out;
}

// Where the holder keeps the tip up, on a coarse grid over the same ground.
class HolderFloor {
 public:
  HolderFloor(const View& view, const LeftOverQuestion& q, const std::vector<Vec3>& points)
      : view_(make_view(view.direction(), points, 4.0, kCoarse)), floor_(view_.cells(), kNone) {
    Envelope obstacle(q.reused, view_);
    std::vector<float> top(view_.cells(), kNone);
    for (std::size_t c = 0; c < top.size(); ++c) top[c] = obstacle.top(c);
    if (q.fixture) {
      const Envelope fixture(*q.fixture, view_);
      for (std::size_t c = 0; c < top.size(); ++c) top[c] = std::max(top[c], fixture.top(c));
    }
    Envelope all(view_, std::move(top));
    for (int j = 0; j < view_.nv; ++j) {
      for (int i = 0; i < view_.nu; ++i) {
        for (const Disc& disc : q.tools.holder.discs) {
          floor_[view_.cell(i, j)] = std::max(floor_[view_.cell(i, j)], under(all, i, j, disc));
        }
      }
    }
  }
  float at(double u, double v) const {
    const int i = static_cast<int>(std::floor((u - view_.u0) / view_.pitch));
    const int j = static_cast<int>(std::floor((v - view_.v0) / view_.pitch));
    if (i < 0 || j < 0 || i >= view_.nu || j >= view_.nv) return kNone;
    return floor_[view_.cell(i, j)];
  }

 private:
  float under(const Envelope& all, int i, int j, const Disc& disc) const {
    const double radius = disc.radius + kWiden;
    const int reach =
        std::isfinite(radius) ? static_cast<int>(radius / kCoarse) : view_.nu + view_.nv;
    float highest = kNone;
    for (int b = std::max(0, j - reach); b <= std::min(view_.nv - 1, j + reach); ++b) {
      for (int a = std::max(0, i - reach); a <= std::min(view_.nu - 1, i + reach); ++a) {
        const double squared = (a - i) * (a - i) + (b - j) * (b - j);
        if (squared * kCoarse * kCoarse > radius * radius) continue;
        highest = std::max(highest, all.top(view_.cell(a, b)));
      }
    }
    return highest - static_cast<float>(disc.height);
  }

  View view_;
  Field floor_;
};

// The lowest surface the cutter can leave from this direction.
CutLayer best_cut(const LeftOverQuestion& q, const Vec3& direction, const std::vector<Vec3>& points,
                  double pitch) {
  const View view = make_view(direction, points, 2 * q.tools.ball_radius + 1.0, pitch);
  const Envelope kept(q.reused, view);
  Field top(view.cells());
  for (std::size_t c = 0; c < top.size(); ++c) top[c] = kept.top(c);
  if (q.fixture) {
    const Envelope fixture(*q.fixture, view);
    for (std::size_t c = 0; c < top.size(); ++c) top[c] = std::max(top[c], fixture.top(c));
  }
  const std::vector<Offset> ball = ball_offsets(q.tools.ball_radius, pitch);
  Field tip = sweep(view, top, ball, -1, kNone, [](float a, float b) { return std::max(a, b); });
  const HolderFloor holder(view, q, points);
  const Vec3 up = view.to_view(Vec3::UnitZ());
  for (int j = 0; j < view.nv; ++j) {
    for (int i = 0; i < view.nu; ++i) {
      float& t = tip[view.cell(i, j)];
      t = std::max({t, holder.at(view.u(i), view.v(j)), -kForbidden});
      if (q.fixture) continue;
      // The tip stays at part z >= 0.
      const double at_zero = up.x() * view.u(i) + up.y() * view.v(j);
      if (std::fabs(up.z()) < 1e-6) {
        if (at_zero < 0) t = kForbidden;
      } else if (up.z() > 0) {
        t = std::max(t, static_cast<float>(-at_zero / up.z()));
      }
    }
  }
  const Field surface =
      sweep(view, tip, ball, +1, kForbidden, [](float a, float b) { return std::min(a, b); });
  return CutLayer(view, {0, 0, view.nu, view.nv}, surface);
}

// Cells of a box grid, true where something is left.
class Lumps {
 public:
  Lumps(const View& view, float low, float high)
      : view_(view),
        low_(low),
        nw_(std::max(1, static_cast<int>(std::ceil((high - low) / view.pitch)))),
        cells_(view.cells() * static_cast<std::size_t>(nw_), false) {}

  void fill(std::size_t column, const Intervals& left) {
    for (const Interval& s : left) {
      const int k0 = std::max(0, index(s.lo)), k1 = std::min(nw_, index(s.hi));
      for (int k = k0; k < k1; ++k) cells_[at(column, k)] = true;
    }
  }
  LeftOver judge() const {
    LeftOver result;
    std::size_t count = 0;
    int longest = 0;
    for (int j = 1; j + 1 < view_.nv; ++j) {
      for (int i = 1; i + 1 < view_.nu; ++i) {
        int run = 0;
        for (int k = 1; k + 1 < nw_; ++k) {
          if (!core(i, j, k)) {
            run = 0;
            continue;
          }
          ++count;
          if (++run <= longest) continue;
          longest = run;
          const double w = low_ + (k + 0.5) * view_.pitch;
          result.where = view_.to_part(Vec3(view_.u(i), view_.v(j), w));
        }
      }
    }
    const double cell = view_.pitch * view_.pitch * view_.pitch;
    if (static_cast<double>(count) * cell < kLumpMin) return {};
    result.volume_mm3 = static_cast<double>(count) * cell;
    result.thickness_mm = (longest + 2) * view_.pitch;
    return result;
  }

 private:
  int index(float w) const {
    return static_cast<int>(std::lround(static_cast<double>(w - low_) / view_.pitch));
  }
  std::size_t at(std::size_t column, int k) const {
    return column * static_cast<std::size_t>(nw_) + static_cast<std::size_t>(k);
  }
  bool core(int i, int j, int k) const {
    const std::size_t c = view_.cell(i, j);
    const auto row = static_cast<std::size_t>(view_.nu);
    return cells_[at(c, k)] && cells_[at(c, k - 1)] && cells_[at(c, k + 1)] &&
           cells_[at(c - 1, k)] && cells_[at(c + 1, k)] && cells_[at(c - row, k)] &&
           cells_[at(c + row, k)];
  }

  View view_;
  float low_;
  int nw_;
  std::vector<bool> cells_;
};

}  // namespace

LeftOver find_left_over(const Stock& stock, const LeftOverQuestion& q) {
  const std::vector<Vec3>& points = q.initial.vertices;
  if (points.empty() || q.directions.empty()) return {};
  Box3 box;
  for (const Vec3& p : points) box.extend(p);
  const Vec3 sizes = box.sizes();
  const double pitch = sizes.prod() / (0.2 * 0.2 * 0.2) > 1e8 ? 0.4 : 0.2;

  Stock ideal(q.initial);
  for (const Vec3& direction : q.directions) ideal.add(best_cut(q, direction, points, pitch));
  const View view = make_view(Vec3::UnitZ(), points, 2 * pitch, pitch);
  const Material is = stock.columns(view);
  const Material could = ideal.columns(view);
  Lumps lumps(view, static_cast<float>(box.min().z() - 2 * pitch),
              static_cast<float>(box.max().z() + 2 * pitch));
  Intervals left;
  for (std::size_t c = 0; c < view.cells(); ++c) {
    subtract(is.original.at(c), could.original.at(c), left);
    lumps.fill(c, left);
  }
  return lumps.judge();
}

}  // namespace reforge::verify

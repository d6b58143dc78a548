#include "planner/verify/envelope.h"

#include <algorithm>
#include <cmath>

namespace reforge::verify {
namespace {

constexpr float kNone = -std::numeric_limits<float>::infinity();
// A node's maximum is computed anew when it would stop a descent and this many cuts touched it.
constexpr std::array<int, 3> kStaleMax{1, 64, 512};

std::vector<float> tops(const Columns& columns) {
  std::vector<float> top(columns.size(), kNone);
  for (std::size_t c = 0; c < columns.size(); ++c) {
    if (!columns.at(c).empty()) top[c] = columns.at(c).back().hi;
  }
  return top;
}

// Distance across of (u, v) from the segment a-b.
double distance(const Vec3& a, const Vec3& b, double u, double v) {
  const double dx = b.x() - a.x(), dy = b.y() - a.y();
  const double px = u - a.x(), py = v - a.y();
  const double squared = dx * dx + dy * dy;
  const double t = squared > 0 ? std::clamp((px * dx + py * dy) / squared, 0.0, 1.0) : 0.0;
  const double ex = px - t * dx, ey = py - t * dy;
  return std::sqrt(ex * ex + ey * ey);
}

}  // namespace

Envelope::Envelope(const View& view, std::vector<float> top) : view_(view), top_(std::move(top)) {
  for (int k = 0; k < kLevels; ++k) {
    Level& level = levels_[k];
    level.shift = 3 * (k + 1);
    const int size = 1 << level.shift;
    level.width = (view.nu + size - 1) / size;
    level.height = (view.nv + size - 1) / size;
    const std::size_t nodes =
        static_cast<std::size_t>(level.width) * static_cast<std::size_t>(level.height);
    level.highest.assign(nodes, kNone);
    level.stale.assign(nodes, 0);
  }
  for (int j = 0; j < view.nv; ++j) {
    for (int i = 0; i < view.nu; ++i) {
      const float h = top_[view.cell(i, j)];
      if (h == kNone) continue;
      for (Level& level : levels_) {
        float& m = level.highest[static_cast<std::size_t>(j >> level.shift) * level.width +
                                 (i >> level.shift)];
        m = std::max(m, h);
      }
    }
  }
}

Envelope::Envelope(const TriangleMesh& mesh, const View& view)
    : Envelope(view, tops(rasterise(mesh, view))) {}

float Envelope::highest() const {
  float m = kNone;
  for (const float h : levels_.back().highest) m = std::max(m, h);
  return m;
}

void Envelope::raise(int i, int j, float height) {
  float& top = top_[view_.cell(i, j)];
  if (height <= top) return;
  top = height;
  for (Level& level : levels_) {
    float& m =
        level
            .highest[static_cast<std::size_t>(j >> level.shift) * level.width + (i >> level.shift)];
    if (m >= height) return;
    m = height;
  }
}

void Envelope::mark_lowered(const CellRect& rect) {
  if (rect.empty()) return;
  for (Level& level : levels_) {
    for (int j = rect.j0 >> level.shift; j <= (rect.j1 - 1) >> level.shift; ++j) {
      for (int i = rect.i0 >> level.shift; i <= (rect.i1 - 1) >> level.shift; ++i) {
        std::uint16_t& stale = level.stale[static_cast<std::size_t>(j) * level.width + i];
        if (stale != 0xffff) ++stale;
      }
    }
  }
}

void Envelope::settle() {
  const Level& root = levels_.back();
  for (int j = 0; j < root.height; ++j) {
    for (int i = 0; i < root.width; ++i) {
      if (root.stale[static_cast<std::size_t>(j) * root.width + i] > 0) refresh(kLevels - 1, i, j);
    }
  }
}

void Envelope::refresh(int k, int i, int j) {
  Level& level = levels_[k];
  const std::size_t node = static_cast<std::size_t>(j) * level.width + i;
  float highest = kNone;
  if (k == 0) {
    const int i1 = std::min((i + 1) * 8, view_.nu), j1 = std::min((j + 1) * 8, view_.nv);
    for (int b = j * 8; b < j1; ++b) {
      for (int a = i * 8; a < i1; ++a) {
        const std::size_t cell = view_.cell(a, b);
        top_[cell] = exact_(cell);
        highest = std::max(highest, top_[cell]);
      }
    }
  } else {
    const Level& fine = levels_[k - 1];
    const int i1 = std::min((i + 1) * 8, fine.width), j1 = std::min((j + 1) * 8, fine.height);
    for (int b = j * 8; b < j1; ++b) {
      for (int a = i * 8; a < i1; ++a) {
        const std::size_t child = static_cast<std::size_t>(b) * fine.width + a;
        if (fine.stale[child] > 0) refresh(k - 1, a, b);
        highest = std::max(highest, fine.highest[child]);
      }
    }
  }
  level.highest[node] = highest;
  level.stale[node] = 0;
}

template <typename Keep, typename Leaf>
void Envelope::descend(int k, const CellRect& box, int i0, int j0, int i1, int j1, const Keep& keep,
                       const Leaf& leaf) {
  if (k < 0) {
    for (int j = std::max(j0, box.j0); j < std::min(j1, box.j1); ++j) {
      for (int i = std::max(i0, box.i0); i < std::min(i1, box.i1); ++i) {
        const float h = top_[view_.cell(i, j)];
        if (h != kNone) leaf(i, j, static_cast<double>(h));
      }
    }
    return;
  }
  Level& level = levels_[k];
  const int size = 1 << level.shift;
  const double half = 0.5 * size * view_.pitch;
  const double half_diagonal = half * std::sqrt(2.0);
  for (int j = std::max(j0, box.j0 >> level.shift);
       j < std::min(j1, ((box.j1 - 1) >> level.shift) + 1); ++j) {
    for (int i = std::max(i0, box.i0 >> level.shift);
         i < std::min(i1, ((box.i1 - 1) >> level.shift) + 1); ++i) {
      const std::size_t node = static_cast<std::size_t>(j) * level.width + i;
      const double u = view_.u0 + i * size * view_.pitch + half;
      const double v = view_.v0 + j * size * view_.pitch + half;
      if (!keep(u, v, half_diagonal, level.highest[node])) continue;
      if (level.stale[node] >= kStaleMax[k]) {
        refresh(k, i, j);
        if (!keep(u, v, half_diagonal, level.highest[node])) continue;
      }
      const int next = k == 0 ? 8 : (1 << 3);
      descend(k - 1, box, i * next, j * next, (i + 1) * next, (j + 1) * next, keep, leaf);
    }
  }
}

CellRect Envelope::around(const Vec3& a, const Vec3& b, double reach) const {
  if (!std::isfinite(reach)) return {0, 0, view_.nu, view_.nv};
  const auto cell = [&](double x, double origin, int n) {
    return static_cast<int>(std::clamp((x - origin) / view_.pitch, 0.0, double(n)));
  };
  return {cell(std::min(a.x(), b.x()) - reach, view_.u0, view_.nu),
          cell(std::min(a.y(), b.y()) - reach, view_.v0, view_.nv),
          cell(std::max(a.x(), b.x()) + reach + view_.pitch, view_.u0, view_.nu),
          cell(std::max(a.y(), b.y()) + reach + view_.pitch, view_.v0, view_.nv)};
}

double Envelope::gap(const SweptDisc& disc, double best, Vec3* where) {
  const double low = std::min(disc.a.z(), disc.b.z());
  const CellRect box = around(disc.a, disc.b, disc.radius + std::max(best, 0.0));
  if (box.empty()) return best;
  const auto keep = [&](double u, double v, double half_diagonal, float highest) {
    if (low - static_cast<double>(highest) >= best) return false;
    return distance(disc.a, disc.b, u, v) - half_diagonal - disc.radius < best;
  };
  const auto leaf = [&](int i, int j, double height) {
    if (low - height >= best) return;
    const double u = view_.u(i), v = view_.v(j);
    const double gap = std::max(low - height, distance(disc.a, disc.b, u, v) - disc.radius);
    if (gap >= best) return;
    best = gap;
    if (where) *where = Vec3(u, v, height);
  };
  const Level& root = levels_[kLevels - 1];
  descend(kLevels - 1, box, 0, 0, root.width, root.height, keep, leaf);
  return best;
}

double Envelope::ball_depth(const Vec3& a, const Vec3& b, double radius, double least,
                            Vec3* where) {
  const double low = std::min(a.z(), b.z());
  const CellRect box = around(a, b, radius);
  if (box.empty()) return least;
  const auto keep = [&](double u, double v, double half_diagonal, float highest) {
    return static_cast<double>(highest) - low > least &&
           distance(a, b, u, v) - half_diagonal < radius;
  };
  const auto leaf = [&](int i, int j, double height) {
    if (height - low <= least) return;
    const double depth = height - swept_ball_height(a, b, radius, view_.u(i), view_.v(j));
    if (!(depth > least)) return;
    least = depth;
    if (where) *where = Vec3(view_.u(i), view_.v(j), height);
  };
  const Level& root = levels_[kLevels - 1];
  descend(kLevels - 1, box, 0, 0, root.width, root.height, keep, leaf);
  return least;
}

double swept_gap(Envelope& envelope, const SweptDisc& disc, double best, Vec3* where) {
  Vec3 at = Vec3::Zero();
  const double whole = envelope.gap(disc, best, &at);
  if (whole >= best) return best;
  constexpr double kRise = 0.05;  // mm: how far apart the heights of one piece may be
  const double rise = std::fabs(disc.b.z() - disc.a.z());
  const bool upright = (disc.b - disc.a).head<2>().norm() < 1e-9;
  if (rise <= kRise || upright) {
    if (where) *where = at;
    return whole;
  }
  const int pieces = static_cast<int>(std::min(std::ceil(rise / kRise), 1000.0));
  for (int k = 0; k < pieces; ++k) {
    const Vec3 p = disc.a + (disc.b - disc.a) * (static_cast<double>(k) / pieces);
    const Vec3 q = disc.a + (disc.b - disc.a) * (static_cast<double>(k + 1) / pieces);
    best = envelope.gap({p, q, disc.radius}, best, where);
  }
  return best;
}

double swept_ball_height(const Vec3& a, const Vec3& b, double radius, double u, double v) {
  const double dx = b.x() - a.x(), dy = b.y() - a.y();
  const double length = std::hypot(dx, dy);
  const double px = u - a.x(), py = v - a.y();
  double low_center = std::min(a.z(), b.z()) + radius;  // upright: the lower end decides
  double slope = 0, q = 0, e_squared = px * px + py * py;
  double along = 0;  // of the ball's centre that is lowest at (u, v)
  if (length > 1e-9) {
    slope = (b.z() - a.z()) / length;
    q = (px * dx + py * dy) / length;
    const double e = (py * dx - px * dy) / length;
    e_squared = e * e;
    const double section = std::sqrt(std::max(radius * radius - e_squared, 0.0));
    along = std::clamp(q - section * slope / std::sqrt(1 + slope * slope), 0.0, length);
    low_center = a.z() + radius;
  }
  const double h_squared = radius * radius - e_squared - (q - along) * (q - along);
  if (h_squared < 0) return std::numeric_limits<double>::infinity();
  return low_center + slope * along - std::sqrt(h_squared);
}

}  // namespace reforge::verify

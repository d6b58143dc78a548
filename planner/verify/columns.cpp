#include "planner/verify/columns.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace reforge::verify {
namespace {

constexpr std::int64_t kSubcells = 1024;

using Triangle = std::array<std::uint32_t, 3>;

struct Crossing {
  float w;
  int sign;  // +1 enters the solid going up, -1 leaves it
};

struct Snapped {
  std::int64_t u, v;
  double w;
};

// Calls emit(cell, w) for every column whose centre lies in the projected triangle.
// Counter-clockwise corners; an edge belongs to the triangle on one side of it only (top-left
// rule).
template <typename Emit>
void cover(const View& view, const std::array<Snapped, 3>& t, std::int64_t doubled_area,
           Emit emit) {
  std::int64_t i_lo = t[0].u, i_hi = t[0].u, j_lo = t[0].v, j_hi = t[0].v;
  for (const Snapped& s : t) {
    i_lo = std::min(i_lo, s.u), i_hi = std::max(i_hi, s.u);
    j_lo = std::min(j_lo, s.v), j_hi = std::max(j_hi, s.v);
  }
  const auto first = [](std::int64_t x) { return (x - kSubcells / 2) / kSubcells; };
  const std::int64_t i0 = std::max<std::int64_t>(0, first(i_lo));
  const std::int64_t j0 = std::max<std::int64_t>(0, first(j_lo));
  const std::int64_t i1 = std::min<std::int64_t>(view.nu - 1, first(i_hi) + 1);
  const std::int64_t j1 = std::min<std::int64_t>(view.nv - 1, first(j_hi) + 1);

  std::array<std::int64_t, 3> du, dv, bias;
  for (std::size_t k = 0; k < 3; ++k) {
    const Snapped& a = t[k];
    const Snapped& b = t[(k + 1) % 3];
    du[k] = b.u - a.u;
    dv[k] = b.v - a.v;
    const bool owned = dv[k] < 0 || (dv[k] == 0 && du[k] > 0);
    bias[k] = owned ? 0 : -1;
  }
  const double inverse = 1.0 / static_cast<double>(doubled_area);
  for (std::int64_t j = j0; j <= j1; ++j) {
    const std::int64_t pv = j * kSubcells + kSubcells / 2;
    for (std::int64_t i = i0; i <= i1; ++i) {
      const std::int64_t pu = i * kSubcells + kSubcells / 2;
      std::array<std::int64_t, 3> e;
      bool inside = true;
      for (std::size_t k = 0; k < 3; ++k) {
        e[k] = du[k] * (pv - t[k].v) - dv[k] * (pu - t[k].u);
        inside = inside && e[k] + bias[k] >= 0;
      }
      if (!inside) continue;
      // e[k] weighs the corner opposite edge k.
      const double w = (static_cast<double>(e[1]) * t[0].w + static_cast<double>(e[2]) * t[1].w +
                        static_cast<double>(e[0]) * t[2].w) *
                       inverse;
      emit(view.cell(static_cast<int>(i), static_cast<int>(j)), w);
    }
  }
}

template <typename Emit>
void cover_mesh(const TriangleMesh& mesh, const View& view, Emit emit) {
  std::vector<Snapped> snapped;
  snapped.reserve(mesh.vertices.size());
  const double scale = static_cast<double>(kSubcells) / view.pitch;
  for (const Vec3& p : mesh.vertices) {
    const Vec3 q = view.to_view(p);
    snapped.push_back(
        {std::llround((q.x() - view.u0) * scale), std::llround((q.y() - view.v0) * scale), q.z()});
  }
  for (const auto& triangle : mesh.triangles) {
    std::array<Snapped, 3> t{snapped[triangle[0]], snapped[triangle[1]], snapped[triangle[2]]};
    std::int64_t area =
        (t[1].u - t[0].u) * (t[2].v - t[0].v) - (t[1].v - t[0].v) * (t[2].u - t[0].u);
    if (area == 0) continue;
    const int sign = area > 0 ? -1 : +1;  // normal upwards: going up leaves the solid
    if (area < 0) {
      std::swap(t[1], t[2]);
      area = -area;
    }
    cover(view, t, area,
          [&](std::size_t cell, double w) { emit(cell, static_cast<float>(w), sign, triangle); });
  }
}

}  // namespace

void Columns::append(const Columns& more) {
  const auto shift = static_cast<std::uint32_t>(items_.size());
  items_.insert(items_.end(), more.items_.begin(), more.items_.end());
  for (std::size_t c = 1; c < more.start_.size(); ++c) start_.push_back(more.start_[c] + shift);
}

double Columns::length() const {
  double sum = 0;
  for (const Interval& s : items_) sum += static_cast<double>(s.hi) - static_cast<double>(s.lo);
  return sum;
}

Columns rasterise(const TriangleMesh& mesh, const View& view) {
  std::vector<std::uint32_t> start(view.cells() + 1, 0);
  cover_mesh(mesh, view, [&](std::size_t cell, float, int, const Triangle&) { ++start[cell + 1]; });
  for (std::size_t c = 0; c < view.cells(); ++c) start[c + 1] += start[c];
  std::vector<Crossing> crossings(start.back());
  std::vector<std::uint32_t> next(start.begin(), start.end() - 1);
  cover_mesh(mesh, view, [&](std::size_t cell, float w, int sign, const Triangle&) {
    crossings[next[cell]++] = {w, sign};
  });

  Columns columns;
  columns.reserve(view.cells(), crossings.size() / 2);
  Intervals column;
  for (std::size_t c = 0; c < view.cells(); ++c) {
    column.clear();
    const auto begin = crossings.begin() + start[c];
    const auto end = crossings.begin() + start[c + 1];
    // Entries come first among equals, so that solids that touch are one.
    std::sort(begin, end, [](const Crossing& a, const Crossing& b) {
      return a.w < b.w || (a.w == b.w && a.sign > b.sign);
    });
    int inside = 0;
    float lo = 0;
    for (auto it = begin; it != end; ++it) {
      if (inside == 0 && it->sign > 0) lo = it->w;
      inside += it->sign;
      if (inside == 0 && it->sign < 0 && it->w > lo) column.push_back({lo, it->w});
    }
    columns.push(column);
  }
  return columns;
}

std::vector<SurfaceSample> sample_surface(const TriangleMesh& mesh, const View& view) {
  std::vector<SurfaceSample> samples;
  cover_mesh(mesh, view, [&](std::size_t cell, float w, int, const Triangle& t) {
    const Vec3& a = mesh.vertices[t[0]];
    const Vec3 normal = (mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a);
    const double cosine = normal.dot(view.direction()) / normal.norm();
    samples.push_back({static_cast<std::uint32_t>(cell), w, static_cast<float>(cosine)});
  });
  return samples;
}

void unite(Intervals& intervals, Interval added, float gap) {
  auto it = intervals.begin();
  while (it != intervals.end() && it->hi + gap < added.lo) ++it;
  auto last = it;
  while (last != intervals.end() && last->lo <= added.hi + gap) {
    added.lo = std::min(added.lo, last->lo);
    added.hi = std::max(added.hi, last->hi);
    ++last;
  }
  if (it == last) {
    intervals.insert(it, added);
  } else {
    *it = added;
    intervals.erase(it + 1, last);
  }
}

void subtract(std::span<const Interval> a, std::span<const Interval> b, Intervals& out) {
  out.clear();
  std::size_t k = 0;
  for (Interval s : a) {
    while (k < b.size() && b[k].hi <= s.lo) ++k;
    for (std::size_t m = k; m < b.size() && b[m].lo < s.hi; ++m) {
      if (b[m].lo > s.lo) out.push_back({s.lo, b[m].lo});
      s.lo = std::max(s.lo, b[m].hi);
    }
    if (s.lo < s.hi) out.push_back(s);
  }
}

double shared_length(std::span<const Interval> a, std::span<const Interval> b) {
  double sum = 0;
  std::size_t i = 0, k = 0;
  while (i < a.size() && k < b.size()) {
    const float lo = std::max(a[i].lo, b[k].lo);
    const float hi = std::min(a[i].hi, b[k].hi);
    if (hi > lo) sum += static_cast<double>(hi) - static_cast<double>(lo);
    if (a[i].hi < b[k].hi) {
      ++i;
    } else {
      ++k;
    }
  }
  return sum;
}

}  // namespace reforge::verify

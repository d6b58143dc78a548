#include "planner/toolpath/region.h"

#include <algorithm>
#include <cmath>
#include <polyclipping/clipper.hpp>

namespace reforge {
namespace {

using ClipperLib::Clipper;
using ClipperLib::Path;
using ClipperLib::Paths;
using ClipperLib::PolyTree;

constexpr double kUnitsPerMm = 1e5;
constexpr double kArcTolerance = 0.01;      // mm, of round corners
constexpr double kOffsetTolerance = 0.005;  // mm: offsets of offsets would double their points
constexpr double kSmallestArea = 1e-6;      // mm^2: rounding leaves no thinner islands

Path to_path(const Polyline& line) {
  Path path;
  path.reserve(line.size());
  for (const Vec2& p : line) {
    path.emplace_back(static_cast<ClipperLib::cInt>(std::llround(p.x() * kUnitsPerMm)),
                      static_cast<ClipperLib::cInt>(std::llround(p.y() * kUnitsPerMm)));
  }
  return path;
}

Paths to_paths(const std::vector<Polyline>& lines) {
  Paths paths;
  paths.reserve(lines.size());
  for (const Polyline& line : lines) paths.push_back(to_path(line));
  return paths;
}

Polyline to_line(const Path& path) {
  Polyline line;
  line.reserve(path.size());
  for (const auto& p : path) {
    line.emplace_back(static_cast<double>(p.X) / kUnitsPerMm,
                      static_cast<double>(p.Y) / kUnitsPerMm);
  }
  return line;
}

PlaneRegion to_region(const Paths& paths) {
  PlaneRegion region;
  for (const Path& path : paths) {
    if (path.size() < 3) continue;
    Polyline ring = to_line(path);
    if (std::abs(signed_area(ring)) > kSmallestArea) region.rings.push_back(std::move(ring));
  }
  return region;
}

PlaneRegion combined(const std::vector<Polyline>& a, const std::vector<Polyline>& b,
                     ClipperLib::ClipType type) {
  Clipper clipper;
  clipper.AddPaths(to_paths(a), ClipperLib::ptSubject, true);
  clipper.AddPaths(to_paths(b), ClipperLib::ptClip, true);
  Paths result;
  clipper.Execute(type, result, ClipperLib::pftNonZero, ClipperLib::pftNonZero);
  return to_region(result);
}

void collect_islands(const ClipperLib::PolyNode& outer, std::vector<PlaneRegion>& out) {
  PlaneRegion island;
  island.rings.push_back(to_line(outer.Contour));
  for (const auto* hole : outer.Childs) {
    island.rings.push_back(to_line(hole->Contour));
    for (const auto* inner : hole->Childs) collect_islands(*inner, out);
  }
  out.push_back(std::move(island));
}

double distance_to_segment(const Vec2& p, const Vec2& a, const Vec2& b) {
  const Vec2 ab = b - a;
  const double l2 = ab.squaredNorm();
  const double t = l2 > 0 ? std::clamp((p - a).dot(ab) / l2, 0.0, 1.0) : 0;
  return (p - a - t * ab).norm();
}

void keep_needed(const Polyline& line, size_t first, size_t last, double tolerance,
                 std::vector<char>& keep) {
  std::vector<std::pair<size_t, size_t>> open{{first, last}};
  while (!open.empty()) {
    const auto [from, to] = open.back();
    open.pop_back();
    double worst = tolerance;
    size_t at = 0;
    for (size_t i = from + 1; i < to; ++i) {
      const double d = distance_to_segment(line[i], line[from], line[to]);
      if (d > worst) {
        worst = d;
        at = i;
      }
    }
    if (at == 0) continue;
    keep[at] = 1;
    open.push_back({from, at});
    open.push_back({at, to});
  }
}

}  // namespace

double signed_area(const Polyline& ring) {
  double twice = 0;
  for (size_t i = 0; i < ring.size(); ++i) {
    const Vec2 &a = ring[i], &b = ring[(i + 1) % ring.size()];
    twice += a.x() * b.y() - a.y() * b.x();
  }
  return twice / 2;
}

double area(const PlaneRegion& region) {
  double sum = 0;
  for (const Polyline& ring : region.rings) sum += signed_area(ring);
  return sum;
}

double length_of(const Polyline& line, bool closed) {
  double sum = 0;
  for (size_t i = 1; i < line.size(); ++i) sum += (line[i] - line[i - 1]).norm();
  if (closed && line.size() > 1) sum += (line.front() - line.back()).norm();
  return sum;
}

PlaneRegion united(const std::vector<Polyline>& rings) {
  return combined(rings, {}, ClipperLib::ctUnion);
}
PlaneRegion united(const PlaneRegion& a, const PlaneRegion& b) {
  return combined(a.rings, b.rings, ClipperLib::ctUnion);
}
PlaneRegion common(const PlaneRegion& a, const PlaneRegion& b) {
  return combined(a.rings, b.rings, ClipperLib::ctIntersection);
}
PlaneRegion without(const PlaneRegion& a, const PlaneRegion& b) {
  return combined(a.rings, b.rings, ClipperLib::ctDifference);
}

PlaneRegion offset(const PlaneRegion& region, double by) {
  ClipperLib::ClipperOffset clipper(2, kArcTolerance * kUnitsPerMm);
  for (const Polyline& ring : region.rings) {
    clipper.AddPath(to_path(simplified(ring, kOffsetTolerance, true)), ClipperLib::jtRound,
                    ClipperLib::etClosedPolygon);
  }
  Paths result;
  clipper.Execute(result, by * kUnitsPerMm);
  PlaneRegion grown = to_region(result);
  for (Polyline& ring : grown.rings) ring = simplified(ring, kOffsetTolerance, true);
  std::erase_if(grown.rings, [](const Polyline& ring) { return ring.size() < 3; });
  return grown;
}

std::vector<Polyline> inside(const std::vector<Polyline>& lines, const PlaneRegion& region) {
  // One line at a time: Clipper does not keep the order of several.
  std::vector<Polyline> pieces;
  const Paths clip = to_paths(region.rings);
  for (const Polyline& line : lines) {
    Clipper clipper;
    clipper.AddPath(to_path(line), ClipperLib::ptSubject, false);
    clipper.AddPaths(clip, ClipperLib::ptClip, true);
    PolyTree tree;
    clipper.Execute(ClipperLib::ctIntersection, tree, ClipperLib::pftNonZero,
                    ClipperLib::pftNonZero);
    Paths open;
    ClipperLib::OpenPathsFromPolyTree(tree, open);
    const Vec2 along = line.back() - line.front();
    std::vector<Polyline> found;
    for (const Path& path : open) {
      Polyline piece = to_line(path);
      if ((piece.back() - piece.front()).dot(along) < 0) std::reverse(piece.begin(), piece.end());
      found.push_back(std::move(piece));
    }
    std::stable_sort(found.begin(), found.end(), [&](const Polyline& a, const Polyline& b) {
      return a.front().dot(along) < b.front().dot(along);
    });
    for (Polyline& piece : found) pieces.push_back(std::move(piece));
  }
  return pieces;
}

bool contains(const PlaneRegion& region, const Vec2& p) {
  bool in = false;
  for (const Polyline& ring : region.rings) {
    for (size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++) {
      const Vec2 &a = ring[i], &b = ring[j];
      if ((a.y() > p.y()) != (b.y() > p.y()) &&
          p.x() < (b.x() - a.x()) * (p.y() - a.y()) / (b.y() - a.y()) + a.x()) {
        in = !in;
      }
    }
  }
  return in;
}

PlaneRegion rectangle(const Vec2& low, const Vec2& high) {
  return {{{low, {high.x(), low.y()}, high, {low.x(), high.y()}}}};
}

std::vector<PlaneRegion> islands(const PlaneRegion& region) {
  Clipper clipper;
  clipper.AddPaths(to_paths(region.rings), ClipperLib::ptSubject, true);
  PolyTree tree;
  clipper.Execute(ClipperLib::ctUnion, tree, ClipperLib::pftNonZero, ClipperLib::pftNonZero);
  std::vector<PlaneRegion> out;
  for (const auto* outer : tree.Childs) collect_islands(*outer, out);
  return out;
}

Polyline simplified(const Polyline& line, double tolerance, bool closed) {
  if (line.size() < 3) return line;
  Polyline work = line;
  if (closed) work.push_back(line.front());
  std::vector<char> keep(work.size(), 0);
  keep.front() = keep.back() = 1;
  if (closed) {
    // A ring has no ends: its farthest point from the first one makes two lines of it.
    size_t far = 0;
    for (size_t i = 1; i + 1 < work.size(); ++i) {
      if ((work[i] - work[0]).squaredNorm() > (work[far] - work[0]).squaredNorm()) far = i;
    }
    keep[far] = 1;
    keep_needed(work, 0, far, tolerance, keep);
    keep_needed(work, far, work.size() - 1, tolerance, keep);
  } else {
    keep_needed(work, 0, work.size() - 1, tolerance, keep);
  }
  Polyline out;
  for (size_t i = 0; i < work.size(); ++i) {
    if (keep[i]) out.push_back(work[i]);
  }
  if (closed) out.pop_back();
  return out;
}

}  // namespace reforge

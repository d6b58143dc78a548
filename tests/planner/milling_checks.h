// What every milling path must keep, checked against the solids themselves.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "planner/geometry/shapes.h"
#include "planner/toolpath/milling.h"

namespace reforge::milling_checks {

inline MillingOptions options_for_tests() {
  MillingOptions options;
  options.cutter = {1.5, 26.5, {{26.5, 56.5, 25, 25}}};
  return options;
}

inline TriangleMesh joined(TriangleMesh a, const TriangleMesh& b) {
  const auto first = static_cast<std::uint32_t>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& t : b.triangles)
    a.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  return a;
}

template <typename Visit>
void along(const std::vector<Path>& paths, const Visit& visit) {
  for (const Path& path : paths) {
    for (size_t i = 1; i < path.moves.size(); ++i) {
      const Vec3 &a = path.moves[i - 1].to, &b = path.moves[i].to;
      const int steps = std::max(1, static_cast<int>(std::ceil((b - a).norm() / 0.1)));
      for (int k = 0; k <= steps; ++k) {
        visit(Vec3(a + (b - a) * (static_cast<double>(k) / steps)), path.moves[i].motion);
      }
    }
  }
}

// How deep the ball enters the solid, at worst, over all moves.
inline double deepest_gouge(const std::vector<Path>& paths, const TriangleMesh& keep,
                            const Frame& frame, double ball) {
  const OffsetSurface surface(keep, frame, ball);
  double worst = 0;
  along(paths, [&](const Vec3& tip, Motion) {
    worst = std::max(worst, surface.centre(tip.x(), tip.y()) - ball - tip.z());
  });
  return worst;
}

// Rapids keep (u, v) or the height, and begin where the last path ended.
inline void expect_orderly_rapids(const std::vector<Path>& paths) {
  for (size_t p = 0; p < paths.size(); ++p) {
    ASSERT_FALSE(paths[p].moves.empty());
    EXPECT_EQ(paths[p].moves.front().motion, Motion::kRapid);
    for (size_t i = 0; i < paths[p].moves.size(); ++i) {
      if (paths[p].moves[i].motion != Motion::kRapid) continue;
      if (p == 0 && i == 0) continue;
      const Vec3 before = i > 0 ? paths[p].moves[i - 1].to : paths[p - 1].moves.back().to;
      const Vec3 d = paths[p].moves[i].to - before;
      EXPECT_TRUE(d.head<2>().norm() < 1e-9 || std::abs(d.z()) < 1e-9);
    }
  }
}

// No feed down by more than `clear` that is steeper than 80 degrees.
inline void expect_no_plunge(const std::vector<Path>& paths, double clear) {
  for (const Path& path : paths) {
    for (size_t i = 1; i < path.moves.size(); ++i) {
      if (path.moves[i].motion == Motion::kRapid || path.moves[i].motion == Motion::kLower)
        continue;
      const Vec3 d = path.moves[i].to - path.moves[i - 1].to;
      if (d.z() < -clear) {
        EXPECT_GT(d.head<2>().norm(), -d.z() * 0.17);
      }
    }
  }
}

}  // namespace reforge::milling_checks

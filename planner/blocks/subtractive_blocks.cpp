#include "planner/blocks/subtractive_blocks.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>

#include "planner/reuse/set_cover.h"
#include "planner/toolpath/finishing.h"

namespace reforge {
namespace {

constexpr double kMapPitch = 0.6;
constexpr double kWorthATurn = 0.004;   // of V_S: less does not pay a further direction
constexpr double kSmallestGain = 4;     // mm^3
constexpr double kSurfaceWorth = 0.01;  // of the surface's samples
constexpr int kSmallestSurface = 12;    // samples
constexpr double kBottomless = -1e4;    // mm: deeper than any part

// The lowest surface that the cutter sweeps along a direction, V_R, fixture, base and holder
// considered.
HeightMap carved_surface(const MillingOptions& options, const Surroundings& solids,
                         const Frame& frame) {
  const double ball = options.cutter.ball_radius_mm;
  const HeightGrid grid = HeightGrid::over(frame, kMapPitch, solids.initial.vertices, ball + 2);
  HeightMap standing = upper_envelope(grid, solids.reused, Sampling::kCentres);
  raise_to(standing, solids.fixture, Sampling::kConservative);
  HeightMap tips = tip_heights_of_ball(standing, ball);
  raise_to(tips, tip_heights(standing, options.cutter.holder, kMapPitch / 2));
  const double per_v = frame.v.z(), per_d = frame.d.z();
  for (int row = 0; row < grid.rows; ++row) {
    const double v = grid.v0 + row * grid.pitch_mm;
    for (int column = 0; column < grid.columns; ++column) {
      float& tip = tips.at(column, row);
      tip = std::max(tip, static_cast<float>(kBottomless));
      if (!options.tip_above_base) continue;
      if (per_d > 1e-9) {
        tip = std::max(tip, static_cast<float>(-v * per_v / per_d));
      } else if (v * per_v < 0) {
        tip = static_cast<float>(-kBottomless);
      }
    }
  }
  // The lower envelope of balls is the upper one of the map turned over.
  for (float& tip : tips.heights) tip = -tip;
  HeightMap swept = tip_heights_of_ball(tips, ball);
  for (float& height : swept.heights) height = -height;
  return swept;
}

BitSet removable(const PartStock& stock, const BitSet& rest, const HeightMap& swept) {
  BitSet out(stock.voxels.size());
  const Vec3& d = swept.grid.frame.d;
  for (size_t i = 0; i < stock.voxels.size(); ++i) {
    if (rest.test(i) && swept.lookup(stock.voxels.points[i]) < d.dot(stock.voxels.points[i]))
      out.set(i);
  }
  return out;
}

struct Candidate {
  Vec3 direction;
  BitSet takes;
  std::vector<int> touches;  // surface samples
};

// The fewest candidates that together serve all there is enough of: rest and surface are grouped by
// the candidates that reach them, each group worth its own direction is an element of a set cover.
// The first `base_directions` win ties.
std::vector<size_t> fewest_directions(const std::vector<Candidate>& candidates,
                                      size_t base_directions, const PartStock& stock,
                                      const BitSet& rest, size_t surface_samples) {
  const size_t count = std::min<size_t>(candidates.size(), 64);
  std::map<std::uint64_t, double> volumes, samples;
  for (size_t i = 0; i < stock.voxels.size(); ++i) {
    if (!rest.test(i)) continue;
    std::uint64_t who = 0;
    for (size_t c = 0; c < count; ++c) {
      if (candidates[c].takes.test(i)) who |= std::uint64_t{1} << c;
    }
    if (who != 0) volumes[who] += stock.voxels.voxel_volume();
  }
  std::vector<std::uint64_t> touched_by(surface_samples, 0);
  for (size_t c = 0; c < count; ++c) {
    for (const int i : candidates[c].touches)
      touched_by[static_cast<size_t>(i)] |= std::uint64_t{1} << c;
  }
  for (const std::uint64_t who : touched_by) {
    if (who != 0) samples[who] += 1;
  }
  const double volume_worth = std::max(kSmallestGain, kWorthATurn * stock.volume_mm3(rest));
  const double samples_worth =
      std::max<double>(kSmallestSurface, kSurfaceWorth * static_cast<double>(surface_samples));
  std::vector<CoverSet> sets(count);
  for (size_t c = 0; c < count; ++c) sets[c].weight = c < base_directions ? 1 : 1.01;
  size_t universe = 0;
  for (const auto& [groups, worth] :
       {std::pair{&volumes, volume_worth}, std::pair{&samples, samples_worth}}) {
    for (const auto& [who, amount] : *groups) {
      if (amount < worth) continue;
      for (size_t c = 0; c < count; ++c) {
        if (who >> c & 1) sets[c].elements.push_back(universe);
      }
      ++universe;
    }
  }
  return cheapest_cover(universe, sets);
}

}  // namespace

BitSet removable_along(const MillingOptions& options, const Surroundings& solids,
                       const PartStock& stock, const Vec3& direction) {
  BitSet rest = stock.rest();
  rest.subtract(stock.near_keep);
  return removable(stock, rest, carved_surface(options, solids, Frame::along(direction)));
}

std::vector<Vec3> milling_directions(const MillingOptions& options, const Surroundings& solids,
                                     const PartStock& stock,
                                     const std::vector<MachinedSample>& surface,
                                     const std::vector<Vec3>& further,
                                     const std::function<bool(const Vec3&)>& reachable) {
  BitSet rest = stock.rest();
  rest.subtract(stock.near_keep);
  std::vector<char> rough(surface.size(), 1);  // samples that no chosen direction touches yet
  std::vector<Candidate> candidates;
  const auto consider = [&](const Vec3& direction) {
    const Vec3 d = direction.normalized();
    if (!reachable(d)) return;
    for (const Candidate& known : candidates) {
      if (known.direction.dot(d) > 0.9998) return;
    }
    const Frame frame = Frame::along(d);
    Candidate candidate{d, removable(stock, rest, carved_surface(options, solids, frame)), {}};
    const TipFloor floor(solids, frame, options, 0);
    HeightMap standing(HeightGrid::over(frame, kMapPitch / 2, solids.initial.vertices, 3));
    raise_to(standing, solids.reused, Sampling::kCentres);
    raise_to(standing, solids.fixture, Sampling::kConservative);
    const Clearance clearance(standing, options.cutter);
    for (int i = 0; i < static_cast<int>(surface.size()); ++i) {
      if (touchable(surface[i], frame, floor, clearance, options.cutter.ball_radius_mm)) {
        candidate.touches.push_back(i);
      }
    }
    candidates.push_back(std::move(candidate));
  };
  for (const Vec3& d :
       {Vec3(0, 0, 1), Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(0, 1, 0), Vec3(0, -1, 0)}) {
    consider(d);
  }
  const size_t base_directions = candidates.size();
  for (const Vec3& d : further) consider(d);

  std::vector<Vec3> chosen;
  std::vector<char> used(candidates.size(), 0);
  const double whole = stock.volume_mm3(rest);
  const auto choose = [&](size_t c) {
    used[c] = 1;
    chosen.push_back(candidates[c].direction);
    rest.subtract(candidates[c].takes);
    for (const int i : candidates[c].touches) rough[static_cast<size_t>(i)] = 0;
  };
  std::vector<char> wanted(candidates.size(), 0);
  for (const size_t c : fewest_directions(candidates, base_directions, stock, rest, surface.size()))
    wanted[c] = 1;
  // The chosen ones by what they take, base directions before others; then, by the same measure,
  // any for the many small groups.
  for (const auto& [limit, any] :
       {std::pair{base_directions, false}, std::pair{candidates.size(), false},
        std::pair{candidates.size(), true}}) {
    for (;;) {
      size_t best = candidates.size();
      double most = any ? std::max(kSmallestGain, kWorthATurn * whole) : -1;
      for (size_t c = 0; c < limit; ++c) {
        if (used[c] || (!any && !wanted[c])) continue;
        BitSet takes = candidates[c].takes;
        const double gain = stock.volume_mm3(takes &= rest);
        if (gain > most) {
          most = gain;
          best = c;
        }
      }
      if (best == candidates.size()) break;
      choose(best);
    }
  }
  for (;;) {
    size_t best = candidates.size();
    int most = std::max(kSmallestSurface,
                        static_cast<int>(kSurfaceWorth * static_cast<double>(surface.size())));
    for (size_t c = 0; c < candidates.size(); ++c) {
      int gain = 0;
      if (!used[c]) {
        for (const int i : candidates[c].touches) gain += rough[static_cast<size_t>(i)];
      }
      if (gain > most) {
        most = gain;
        best = c;
      }
    }
    if (best == candidates.size()) break;
    choose(best);
  }
  return chosen;
}

}  // namespace reforge

#include "planner/blocks/milled_blocks.h"

#include <algorithm>

#include "planner/blocks/subtractive_blocks.h"
#include "planner/toolpath/finishing.h"
#include "planner/toolpath/roughing.h"

namespace reforge {
namespace {

constexpr double kMapPitch = 0.3;
constexpr int kSecondLooks = 4;            // blocks that only mend what others missed
constexpr double kSmallestLump = 0.4;      // mm^3 worth a block of its own
constexpr double kSecondLookWorth = 0.01;  // of the surface's samples
constexpr int kSecondLookLeast = 15;       // samples

struct Outlook {
  Frame frame;
  std::vector<char> touches;  // by sample
};

Outlook outlook(const MillingOptions& options, const Surroundings& solids,
                const std::vector<MachinedSample>& surface, const Vec3& direction) {
  Outlook out{Frame::along(direction), {}};
  const TipFloor floor(solids, out.frame, options, 0);
  HeightMap standing(HeightGrid::over(out.frame, kMapPitch, solids.initial.vertices, 3));
  raise_to(standing, solids.reused, Sampling::kCentres);
  raise_to(standing, solids.fixture, Sampling::kConservative);
  const Clearance clearance(standing, options.cutter);
  for (const MachinedSample& sample : surface) {
    out.touches.push_back(
        touchable(sample, out.frame, floor, clearance, options.cutter.ball_radius_mm));
  }
  return out;
}

}  // namespace

Milling mill_blocks(const MillingOptions& options, const Surroundings& solids,
                    const std::vector<MachinedSample>& surface, const std::vector<Vec3>& directions,
                    const std::function<bool()>& interrupted,
                    const std::function<void(const std::string&)>& progress, PartStock& stock) {
  Milling milling;
  milling.samples = surface.size();
  std::vector<Outlook> outlooks;
  for (const Vec3& d : directions) outlooks.push_back(outlook(options, solids, surface, d));
  // The direction that looks at a sample most squarely, among those that touch it.
  std::vector<size_t> best(surface.size(), directions.size());
  for (size_t i = 0; i < surface.size(); ++i) {
    double square = -2;
    for (size_t k = 0; k < directions.size(); ++k) {
      const double cosine = surface[i].normal.dot(outlooks[k].frame.d);
      if (outlooks[k].touches[i] && cosine > square + 1e-6) {
        square = cosine;
        best[i] = k;
      }
    }
    milling.samples_touchable += best[i] < directions.size();
  }
  std::vector<char> done(surface.size(), 0);
  const auto mill = [&](size_t k, const std::vector<char>& wanted) {
    const Frame& frame = outlooks[k].frame;
    BlockStock block(stock, solids, frame, options.cutter);
    MilledBlock milled;
    milled.toolpath.kind = BlockKind::kMill;
    milled.toolpath.frame = frame;
    milled.toolpath.paths = rough(options, solids, interrupted, block);
    finish(options, solids, surface, wanted, interrupted, block, done, milled.toolpath.paths);
    milled.removed = block.commit(stock);
    milled.removed_mm3 = stock.volume_mm3(milled.removed);
    if (!milled.toolpath.paths.empty()) milling.blocks.push_back(std::move(milled));
  };
  for (size_t k = 0; k < directions.size() && !interrupted(); ++k) {
    progress("milling " + std::to_string(k + 1) + " of " + std::to_string(directions.size()));
    std::vector<char> wanted(surface.size(), 0);
    for (size_t i = 0; i < surface.size(); ++i) {
      // Its own, and what earlier directions should have finished but could not.
      wanted[i] = !done[i] && outlooks[k].touches[i] && best[i] <= k;
    }
    mill(k, wanted);
  }
  // What stood in the holder's way is gone by now: lumps that a direction could take are taken,
  // then surface that it could finish is finished.
  std::vector<char> exhausted(directions.size(), 0);
  for (int look = 0; look < kSecondLooks && !interrupted(); ++look) {
    size_t chosen = directions.size(), most = 0;
    double largest = kSmallestLump;
    for (size_t k = 0; k < directions.size(); ++k) {
      if (exhausted[k]) continue;
      const double lump = stock.volume_mm3(removable_along(options, solids, stock, directions[k]));
      if (lump > largest) {
        largest = lump;
        chosen = k;
      }
    }
    const bool lumps = chosen < directions.size();
    for (size_t k = 0; k < directions.size() && !lumps; ++k) {
      if (exhausted[k]) continue;
      size_t missing = 0;
      for (size_t i = 0; i < surface.size(); ++i) missing += !done[i] && outlooks[k].touches[i];
      if (missing > most) {
        most = missing;
        chosen = k;
      }
    }
    const auto worth = static_cast<size_t>(
        std::max<double>(kSecondLookLeast, kSecondLookWorth * static_cast<double>(surface.size())));
    if (!lumps && most < worth) break;
    std::vector<char> wanted(surface.size(), 0);
    for (size_t i = 0; i < surface.size(); ++i) wanted[i] = !done[i] && outlooks[chosen].touches[i];
    const std::vector<char> done_before = done;
    const BitSet present_before = stock.present;
    const size_t blocks_before = milling.blocks.size();
    mill(chosen, wanted);
    const auto finished = std::count(done.begin(), done.end(), 1) -
                          std::count(done_before.begin(), done_before.end(), 1);
    const bool block_made = milling.blocks.size() > blocks_before;
    const double removed = block_made ? milling.blocks.back().removed_mm3 : 0;
    // Little more comes of it, if anything: what is left there only seemed within reach.
    exhausted[chosen] = removed < largest / 2 && finished < static_cast<std::ptrdiff_t>(worth);
    if (block_made && removed < kSmallestLump && finished < static_cast<std::ptrdiff_t>(worth)) {
      milling.blocks.pop_back();  // not worth a turn of the table
      done = done_before;
      stock.present = present_before;
    }
  }
  for (size_t i = 0; i < surface.size(); ++i) milling.samples_finished += done[i];
  BitSet left = stock.rest();
  left.subtract(stock.near_keep);
  milling.left_mm3 = stock.volume_mm3(left);
  return milling;
}

}  // namespace reforge

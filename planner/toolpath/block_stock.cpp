#include "planner/toolpath/block_stock.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace reforge {
namespace {

constexpr double kPitch = 0.3;  // mm, of the maps
constexpr double kMargin = 6;   // mm around the stock: the cutter's own width and a link's
constexpr double kRestTolerance = 0.05;
constexpr int kCoarser = 3;               // the holder's map: cells of 3 x 3
constexpr double kLinkClearance = 1;      // mm above everything under a link
constexpr double kHolderClearance = 0.3;  // mm beside and above the holder
constexpr double kSkin = 0.5;  // mm of the ball's edge that may shave what is next to V_R
constexpr float kUncut = std::numeric_limits<float>::infinity();

struct Cell {
  int column, row;
};
Cell cell_at(const HeightGrid& grid, double u, double v) {
  return {static_cast<int>(std::floor((u - grid.u0) / grid.pitch_mm + 0.5)),
          static_cast<int>(std::floor((v - grid.v0) / grid.pitch_mm + 0.5))};
}

// Calls visit(cell index, height of the ball's surface above its tip) for the cells under the ball.
template <typename Visit>
void under_ball(const HeightMap& map, double ball, double u, double v, const Visit& visit) {
  const HeightGrid& grid = map.grid;
  const Cell low = cell_at(grid, u - ball, v - ball), high = cell_at(grid, u + ball, v + ball);
  for (int row = std::max(0, low.row); row <= std::min(grid.rows - 1, high.row); ++row) {
    const double dv = grid.v0 + row * grid.pitch_mm - v;
    for (int column = std::max(0, low.column); column <= std::min(grid.columns - 1, high.column);
         ++column) {
      const double du = grid.u0 + column * grid.pitch_mm - u;
      const double left = ball * ball - du * du - dv * dv;
      if (left < 0) continue;
      visit(static_cast<size_t>(row) * grid.columns + column, ball - std::sqrt(left));
    }
  }
}

HeightMap coarser(const HeightMap& fine) {
  HeightGrid grid = fine.grid;
  grid.pitch_mm *= kCoarser;
  grid.u0 += fine.grid.pitch_mm;  // the middle of the first 3 x 3
  grid.v0 += fine.grid.pitch_mm;
  grid.columns = (fine.grid.columns + kCoarser - 1) / kCoarser;
  grid.rows = (fine.grid.rows + kCoarser - 1) / kCoarser;
  HeightMap map(grid);
  for (int row = 0; row < fine.grid.rows; ++row) {
    for (int column = 0; column < fine.grid.columns; ++column) {
      float& cell = map.at(column / kCoarser, row / kCoarser);
      cell = std::max(cell, fine.at(column, row));
    }
  }
  return map;
}

}  // namespace

BlockStock::BlockStock(const PartStock& stock, const Surroundings& solids, const Frame& frame,
                       const Cutter& cutter)
    : ball_(cutter.ball_radius_mm),
      rest_top_(HeightGrid::over(frame, kPitch, solids.initial.vertices,
                                 kMargin + cutter.ball_radius_mm)),
      rest_bottom_(rest_top_.grid),
      skin_top_(rest_top_.grid),
      whole_(rest_top_.grid),
      floor_(upper_envelope(rest_top_.grid, solids.reused, Sampling::kConservative)),
      cut_(rest_top_.grid) {
  std::fill(cut_.heights.begin(), cut_.heights.end(), kUncut);
  const VoxelSet& voxels = stock.voxels;
  const double half = voxels.grid.pitch_mm / 2;
  // A voxel's cube reaches this far from its centre along each axis of the frame.
  const double reach_u = half * frame.u.cwiseAbs().sum(), reach_v = half * frame.v.cwiseAbs().sum();
  const double reach_d = half * frame.d.cwiseAbs().sum();
  const HeightGrid& grid = rest_top_.grid;
  for (size_t i = 0; i < voxels.size(); ++i) {
    if (!stock.present.test(i)) continue;
    const Vec3 at = frame.to_local(voxels.points[i]);
    const bool skin = stock.near_keep.test(i);
    const bool rest = !stock.keep.test(i) && !skin;
    const auto top = static_cast<float>(at.z() + reach_d),
               bottom = static_cast<float>(at.z() - reach_d);
    const Cell low = cell_at(grid, at.x() - reach_u, at.y() - reach_v);
    const Cell high = cell_at(grid, at.x() + reach_u, at.y() + reach_v);
    for (int row = low.row; row <= high.row; ++row) {
      for (int column = low.column; column <= high.column; ++column) {
        if (!whole_.contains(column, row)) continue;
        whole_.at(column, row) = std::max(whole_.at(column, row), top);
        if (skin) skin_top_.at(column, row) = std::max(skin_top_.at(column, row), top);
        if (!rest) continue;
        float& lowest = rest_bottom_.at(column, row);
        lowest = rest_top_.at(column, row) == HeightMap::kEmpty ? bottom : std::min(lowest, bottom);
        rest_top_.at(column, row) = std::max(rest_top_.at(column, row), top);
      }
    }
  }
  const HeightMap initial = upper_envelope(grid, solids.initial, Sampling::kConservative);
  for (size_t c = 0; c < whole_.heights.size(); ++c) {
    whole_.heights[c] =
        std::max(std::min(whole_.heights[c], initial.heights[c]), floor_.heights[c]);
    rest_top_.heights[c] = std::min(rest_top_.heights[c], initial.heights[c]);
    skin_top_.heights[c] = std::min(skin_top_.heights[c], initial.heights[c]);
  }
  raise_to(floor_, solids.fixture, Sampling::kConservative);
}

float BlockStock::rest_height(size_t cell) const {
  const float top = std::min(rest_top_.heights[cell], cut_.heights[cell]);
  return top > rest_bottom_.heights[cell] + kRestTolerance ? top : HeightMap::kEmpty;
}

BlockStock::Span BlockStock::rest_span() const {
  Span span{1e300, -1e300, true};
  for (size_t c = 0; c < cut_.heights.size(); ++c) {
    const float top = rest_height(c);
    if (top == HeightMap::kEmpty) continue;
    span.low = std::min<double>(span.low, rest_bottom_.heights[c]);
    span.high = std::max<double>(span.high, top);
    span.empty = false;
  }
  return span;
}

bool BlockStock::rest_above_cell(int column, int row, double height) const {
  const size_t cell = static_cast<size_t>(row) * cut_.grid.columns + column;
  return rest_height(cell) > height + kRestTolerance;
}

bool BlockStock::rest_above(double u, double v, double height) const {
  const Cell cell = cell_at(cut_.grid, u, v);
  return cut_.contains(cell.column, cell.row) && rest_above_cell(cell.column, cell.row, height);
}

double BlockStock::rest_depth(const Vec3& tip) const {
  double deepest = -std::numeric_limits<double>::infinity();
  under_ball(cut_, ball_, tip.x(), tip.y(), [&](size_t cell, double surface) {
    deepest = std::max(deepest, rest_height(cell) - tip.z() - surface);
  });
  return deepest;
}

double BlockStock::loose_depth(const Vec3& tip) const {
  double deepest = rest_depth(tip);
  const double middle =
      ball_ - std::sqrt(std::max(0.0, ball_ * ball_ - std::pow(ball_ - kSkin, 2)));
  under_ball(cut_, ball_, tip.x(), tip.y(), [&](size_t cell, double surface) {
    if (surface > middle) return;
    const float top = std::min(skin_top_.heights[cell], cut_.heights[cell]);
    deepest = std::max(deepest, top - tip.z() - surface);
  });
  return deepest;
}

double BlockStock::touch_depth(const Vec3& tip) const {
  double deepest = -std::numeric_limits<double>::infinity();
  // The maps are exact at cell centres only: what stands in a cell may be half a cell nearer.
  constexpr double kNearer = kPitch * 0.7072;
  under_ball(cut_, ball_ + kNearer, tip.x(), tip.y(), [&](size_t cell, double surface) {
    const float top = std::min(whole_.heights[cell], cut_.heights[cell]);
    deepest = std::max(deepest, top - tip.z() - std::max(0.0, surface - kNearer));
  });
  return deepest;
}

void BlockStock::cut(const Vec3& a, const Vec3& b) {
  const double run = (b - a).norm();
  const int steps = std::max(1, static_cast<int>(std::ceil(run / kPitch)));
  for (int i = 0; i <= steps; ++i) {
    const Vec3 tip = a + (b - a) * (static_cast<double>(i) / steps);
    under_ball(cut_, ball_, tip.x(), tip.y(), [&](size_t cell, double surface) {
      float& height = cut_.heights[cell];
      height = std::min(height, static_cast<float>(tip.z() + surface));
    });
  }
}

HeightMap BlockStock::standing() const {
  HeightMap now(cut_.grid);
  for (size_t c = 0; c < now.heights.size(); ++c) {
    now.heights[c] = std::max(floor_.heights[c], std::min(whole_.heights[c], cut_.heights[c]));
  }
  return now;
}

BitSet BlockStock::commit(PartStock& stock) const {
  BitSet removed(stock.voxels.size());
  for (size_t i = 0; i < stock.voxels.size(); ++i) {
    if (!stock.present.test(i) || stock.keep.test(i)) continue;
    const Vec3 at = cut_.grid.frame.to_local(stock.voxels.points[i]);
    const Cell cell = cell_at(cut_.grid, at.x(), at.y());
    if (!cut_.contains(cell.column, cell.row) || at.z() <= cut_.at(cell.column, cell.row)) continue;
    removed.set(i);
    stock.present.clear(i);
  }
  return removed;
}

Clearance::Clearance(const HeightMap& standing, const Cutter& cutter)
    : holder_(coarser(standing)), free_(holder_) {
  const double half_cell = holder_.grid.pitch_mm / 2;
  const HeightMap base = holder_;
  std::vector<ToolSection> holder = cutter.holder;
  for (ToolSection& section : holder) {
    section.z_from_mm -= kHolderClearance;
    section.z_to_mm -= kHolderClearance;
  }
  holder_ = tip_heights(base, holder, kHolderClearance + half_cell);
  free_ = dilated(base, cutter.ball_radius_mm + 2 * half_cell + kHolderClearance);
  raise_to(free_, holder_);
}

double Clearance::look_up(const HeightMap& map, double u, double v) {
  const Cell cell = cell_at(map.grid, u, v);
  return map.contains(cell.column, cell.row) ? map.at(cell.column, cell.row) : HeightMap::kEmpty;
}

double Clearance::link_height(const Vec2& a, const Vec2& b) const {
  const int steps =
      std::max(1, static_cast<int>(std::ceil((b - a).norm() / (free_.grid.pitch_mm / 2))));
  double height = HeightMap::kEmpty;
  for (int i = 0; i <= steps; ++i) {
    const Vec2 p = a + (b - a) * (static_cast<double>(i) / steps);
    height = std::max(height, look_up(free_, p.x(), p.y()));
  }
  return height + kLinkClearance;
}

}  // namespace reforge

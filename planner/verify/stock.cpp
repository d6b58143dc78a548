#include "planner/verify/stock.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <future>
#include <system_error>
#include <thread>
#include <utility>

namespace reforge::verify {
namespace {

// The line of a column of `view`, in a layer's coordinates.
class LineMap {
 public:
  LineMap(const View& view, const View& layer_view, const CellRect& rect)
      : turn_(layer_view.rotation * view.rotation.transpose()), view_(layer_view), rect_(rect) {
    // Directions equal up to rounding are equal: a column then stays in one cell.
    for (int k = 0; k < 2; ++k) {
      if (std::fabs(turn_(k, 2)) < 1e-9) turn_(k, 2) = 0;
    }
  }
  LayerLine at(double u, double v) const {
    const Vec3 q = turn_ * Vec3(u, v, 0);
    return {(q.x() - view_.u0) / view_.pitch - 0.5 - rect_.i0,
            (q.y() - view_.v0) / view_.pitch - 0.5 - rect_.j0,
            q.z(),
            turn_(0, 2) / view_.pitch,
            turn_(1, 2) / view_.pitch,
            turn_(2, 2)};
  }

 private:
  Eigen::Matrix3d turn_;
  View view_;
  CellRect rect_;
};

constexpr int kTile = 8;         // columns walked together, each way
constexpr double kFar = 1e4;     // mm, beyond any part
constexpr unsigned kShares = 4;  // threads at most
constexpr std::size_t kCellsWorthThreads = 50000;

// A tile of columns on their way through the layers.
struct Tile {
  std::array<Intervals, kTile * kTile> original, deposited, removed;
  std::vector<LineStretch> lines;
  Intervals scratch;

  void cut(const CutLayer& layer, std::array<Intervals, kTile * kTile>& material) {
    for (std::size_t k = 0; k < lines.size(); ++k) {
      removed[k].clear();
      const bool none = material[k].empty();
      lines[k].t0 = none ? 0.0 : static_cast<double>(material[k].front().lo);
      lines[k].t1 = none ? 0.0 : static_cast<double>(material[k].back().hi);
    }
    layer.removed_on(lines, removed);
    for (std::size_t k = 0; k < lines.size(); ++k) {
      if (removed[k].empty()) continue;
      subtract(material[k], removed[k], scratch);
      material[k].swap(scratch);
    }
  }
  void add(const DepositLayer& layer) {
    for (LineStretch& s : lines) s.t0 = -kFar, s.t1 = kFar;
    layer.added_on(lines, deposited);
  }
};

}  // namespace

// Rows [begin, end) of a view, walked tile by tile through the layers.
Material Stock::rows(const View& view, const Columns& cast, int begin, int end) const {
  std::vector<LineMap> maps;
  for (const auto& layer : layers_) {
    maps.push_back(
        std::visit([&](const auto& l) { return LineMap(view, l.view(), l.rect()); }, layer));
  }
  Material material;
  Tile tile;
  // A band of rows is walked tile by tile, and then handed on row by row.
  std::vector<Intervals> original(static_cast<std::size_t>(view.nu) * kTile), deposited(original);
  for (int j0 = begin; j0 < end; j0 += kTile) {
    const int rows = std::min(kTile, end - j0);
    for (int i0 = 0; i0 < view.nu; i0 += kTile) {
      const int width = std::min(kTile, view.nu - i0);
      const auto slot = [&](std::size_t k) {
        const int j = static_cast<int>(k) / width, i = i0 + static_cast<int>(k) % width;
        return std::pair(i, j);
      };
      const auto count = static_cast<std::size_t>(rows * width);
      tile.lines.resize(count);
      for (std::size_t k = 0; k < count; ++k) {
        const auto [i, j] = slot(k);
        const auto solid = cast.at(view.cell(i, j0 + j));
        tile.original[k].assign(solid.begin(), solid.end());
        tile.deposited[k].clear();
      }
      for (std::size_t l = 0; l < layers_.size(); ++l) {
        for (std::size_t k = 0; k < count; ++k) {
          const auto [i, j] = slot(k);
          tile.lines[k].line = maps[l].at(view.u(i), view.v(j0 + j));
        }
        if (const auto* cutting = std::get_if<CutLayer>(&layers_[l])) {
          tile.cut(*cutting, tile.original);
          tile.cut(*cutting, tile.deposited);
        } else {
          tile.add(std::get<DepositLayer>(layers_[l]));
        }
      }
      for (std::size_t k = 0; k < count; ++k) {
        const auto [i, j] = slot(k);
        const auto to = static_cast<std::size_t>(j) * static_cast<std::size_t>(view.nu) +
                        static_cast<std::size_t>(i);
        original[to].swap(tile.original[k]);
        deposited[to].swap(tile.deposited[k]);
      }
    }
    for (std::size_t k = 0; k < static_cast<std::size_t>(rows) * view.nu; ++k) {
      material.original.push(original[k]);
      material.deposited.push(deposited[k]);
    }
  }
  return material;
}

Material Stock::columns(const View& view) const {
  const Columns cast = rasterise(initial_, view);
  // Shares of whole bands; what comes out does not depend on their number.
  const auto cores = static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1u, kShares));
  const int shares = view.cells() < kCellsWorthThreads || layers_.empty() ? 1 : cores;
  const int bands = (view.nv + kTile - 1) / kTile;
  const auto row = [&](int share) { return std::min(view.nv, bands * share / shares * kTile); };
  std::vector<Material> parts(static_cast<std::size_t>(shares));
  std::vector<std::future<void>> others;
  for (int k = 1; k < shares; ++k) {
    const auto work = [&, k] {
      parts[static_cast<std::size_t>(k)] = rows(view, cast, row(k), row(k + 1));
    };
    try {
      others.push_back(std::async(std::launch::async, work));
    } catch (const std::system_error&) {  // no thread to be had: it is done here
      work();
    }
  }
  Material material = rows(view, cast, 0, row(1));
  for (std::future<void>& other : others) other.get();
  for (std::size_t k = 1; k < parts.size(); ++k) {
    material.original.append(parts[k].original);
    material.deposited.append(parts[k].deposited);
    parts[k] = {};
  }
  return material;
}

std::size_t Stock::bytes() const {
  std::size_t sum = 0;
  for (const auto& layer : layers_) {
    sum += std::visit([](const auto& l) { return l.bytes(); }, layer);
  }
  return sum;
}

}  // namespace reforge::verify

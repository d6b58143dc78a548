#include "planner/verify/stock.h"

#include <cmath>

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

void cut(const CutLayer& layer, const LayerLine& line, Intervals& material, Intervals& scratch,
         Intervals& removed) {
  if (material.empty()) return;
  removed.clear();
  layer.removed_on(line, static_cast<double>(material.front().lo),
                   static_cast<double>(material.back().hi), removed);
  if (removed.empty()) return;
  subtract(material, removed, scratch);
  material.swap(scratch);
}

}  // namespace

Material Stock::columns(const View& view) const {
  const Columns cast = rasterise(initial_, view);
  std::vector<LineMap> maps;
  for (const auto& layer : layers_) {
    maps.push_back(
        std::visit([&](const auto& l) { return LineMap(view, l.view(), l.rect()); }, layer));
  }
  Material material;
  material.original.reserve(view.cells(), cast.intervals());
  material.deposited.reserve(view.cells(), 0);
  constexpr double kFar = 1e4;  // mm, beyond any part
  Intervals original, deposited, scratch, removed;
  for (int j = 0; j < view.nv; ++j) {
    for (int i = 0; i < view.nu; ++i) {
      const auto solid = cast.at(view.cell(i, j));
      original.assign(solid.begin(), solid.end());
      deposited.clear();
      for (std::size_t k = 0; k < layers_.size(); ++k) {
        const LayerLine line = maps[k].at(view.u(i), view.v(j));
        if (const auto* cutting = std::get_if<CutLayer>(&layers_[k])) {
          cut(*cutting, line, original, scratch, removed);
          cut(*cutting, line, deposited, scratch, removed);
        } else {
          std::get<DepositLayer>(layers_[k]).added_on(line, -kFar, kFar, deposited);
        }
      }
      material.original.push(original);
      material.deposited.push(deposited);
    }
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

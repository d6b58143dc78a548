#include "planner/reuse/feasible_offset.h"

#include <cmath>

namespace reforge {
namespace {

constexpr int kSteps = 16;  // 0.7^16 = 0.3 % of the way left
constexpr int kBisections = 6;

// The highest of V~_R's samples that stand on the base, along a plane's normal.
double base_offset(const ClippingModel& model, const Vec3& normal) {
  double highest = -1e300;
  for (const Vec3& point : model.samples().points) {
    if (point.z() < model.samples().grid.pitch_mm) highest = std::max(highest, normal.dot(point));
  }
  return highest;
}

// Every plane of `start` moved by `part` of its way to the base.
Clipping moved(const ClippingModel& model, const Clipping& start, double part) {
  std::vector<std::shared_ptr<Cut>> cuts(start.cuts.size());
  for (std::size_t s = 0; s < cuts.size(); ++s) {
    if (!start.cuts[s]) continue;
    Plane plane = start.cuts[s]->plane;
    plane.offset -= part * std::max(0.0, plane.offset - base_offset(model, plane.normal));
    cuts[s] = model.cut(s, plane);
    if (!cuts[s]) cuts[s] = start.cuts[s];  // it would take the foot: it stays where it was
  }
  Clipping result = model.combine(std::move(cuts));
  model.count_blocked(result);
  return result;
}

template <typename At>
std::optional<Clipping> least(At at) {
  double infeasible = 0;
  for (int step = 1; step <= kSteps; ++step) {
    double feasible = 1 - std::pow(0.7, step);
    Clipping best = at(feasible);
    if (!best.feasible()) {
      infeasible = feasible;
      continue;
    }
    for (int i = 0; i < kBisections; ++i) {
      const double middle = (infeasible + feasible) / 2;
      Clipping tried = at(middle);
      if (tried.feasible()) {
        feasible = middle;
        best = std::move(tried);
      } else {
        infeasible = middle;
      }
    }
    return best;
  }
  return std::nullopt;
}

}  // namespace

std::optional<Clipping> feasible_offset(const ClippingModel& model, const Clipping& start) {
  if (start.feasible()) return start;
  if (auto found = least([&](double part) { return moved(model, start, part); })) return found;
  for (std::size_t s = 0; s < model.slots().size(); ++s) {
    if (model.slots()[s].anchors.size() != model.samples().size()) continue;
    const double top = model.highest_offset(model.slots()[s], Vec3::UnitZ());
    return least([&](double part) {
      std::vector<std::shared_ptr<Cut>> cuts(start.cuts.size());
      cuts[s] = model.cut(s, {Vec3::UnitZ(), top * (1 - part)});
      Clipping result = model.combine(std::move(cuts));
      model.count_blocked(result);
      return result;
    });
  }
  return std::nullopt;
}

}  // namespace reforge

#include "planner/reuse/blockers.h"

#include <algorithm>
#include <cmath>

namespace reforge {

Blockers::Blockers(const BitSet& set) {
  for (std::uint32_t w = 0; w < set.words.size(); ++w) {
    if (set.words[w]) words.push_back({w, set.words[w]});
  }
}

ToolProfile::ToolProfile(std::span<const ToolSection> sections, double widen, double lower) {
  double radius = 0;
  for (const ToolSection& section : sections) {
    const double wider = std::max({radius, section.r_from_mm, section.r_to_mm});
    if (wider <= radius) continue;
    const double from = section.z_from_mm - (radius > 0 ? lower : 0);
    radius = wider;
    if (std::isinf(radius)) {
      infinite_from = static_cast<float>(from);
      return;
    }
    widest = static_cast<float>(radius + widen);
    steps.push_back({static_cast<float>(from), widest * widest});
  }
}

bool ToolProfile::within(const ToolProfile& other) const {
  if (infinite_from < other.infinite_from) return false;
  for (const Step& step : steps) {
    if (step.from >= other.infinite_from) continue;
    float square = 0;
    for (const Step& theirs : other.steps) {
      if (theirs.from <= step.from) square = theirs.square;
    }
    if (square < step.square) return false;
  }
  return true;
}

DirectedSamples::DirectedSamples(const VoxelSet& samples, const Vec3& direction)
    : frame_(Frame::along(direction)) {
  std::vector<std::pair<float, std::uint32_t>> order;
  order.reserve(samples.size());
  for (std::uint32_t i = 0; i < samples.size(); ++i) {
    order.emplace_back(static_cast<float>(samples.points[i].dot(direction)), i);
  }
  std::sort(order.begin(), order.end());
  u_.reserve(order.size());
  v_.reserve(order.size());
  h_.reserve(order.size());
  number_.reserve(order.size());
  for (const auto& [height, i] : order) {
    u_.push_back(static_cast<float>(frame_.u.dot(samples.points[i])));
    v_.push_back(static_cast<float>(frame_.v.dot(samples.points[i])));
    h_.push_back(height);
    number_.push_back(i);
  }
}

std::size_t DirectedSamples::above(float height) const {
  return static_cast<std::size_t>(std::upper_bound(h_.begin(), h_.end(), height) - h_.begin());
}

std::size_t DirectedSamples::least(const ToolProfile& tool, const Vec3& tip) const {
  return h_.size() - above(static_cast<float>(frame_.d.dot(tip)) + tool.infinite_from);
}

template <typename Visit>
void DirectedSamples::visit_finite(const ToolProfile& tool, const Vec3& local, Visit visit) const {
  const auto u = static_cast<float>(local.x()), v = static_cast<float>(local.y());
  const auto tip = static_cast<float>(local.z());
  const std::size_t end = above(tip + tool.infinite_from);
  for (std::size_t k = tool.steps.size(); k-- > 0;) {
    const std::size_t from = above(tip + tool.steps[k].from);
    const std::size_t to =
        k + 1 < tool.steps.size() ? std::min(end, above(tip + tool.steps[k + 1].from)) : end;
    for (std::size_t i = from; i < to; ++i) {
      const float du = u_[i] - u, dv = v_[i] - v;
      if (du * du + dv * dv < tool.steps[k].square && !visit(number_[i])) return;
    }
  }
}

std::size_t DirectedSamples::count(const ToolProfile& tool, const Vec3& tip,
                                   std::size_t most) const {
  std::size_t found = least(tool, tip);
  if (found > most) return found;
  visit_finite(tool, frame_.to_local(tip), [&](std::uint32_t) { return ++found <= most; });
  return found;
}

BitSet DirectedSamples::find(const ToolProfile& tool, const Vec3& tip) const {
  BitSet found(number_.size());
  for (std::size_t i = number_.size() - least(tool, tip); i < number_.size(); ++i)
    found.set(number_[i]);
  visit_finite(tool, frame_.to_local(tip), [&](std::uint32_t number) {
    found.set(number);
    return true;
  });
  return found;
}

}  // namespace reforge

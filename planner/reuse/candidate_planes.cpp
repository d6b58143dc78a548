#include "planner/reuse/candidate_planes.h"

#include <cmath>
#include <numbers>

#include "planner/reuse/set_cover.h"

namespace reforge {
namespace {

// Onto the upper hemisphere: what looks down is turned level.
Vec3 lifted(Vec3 normal) {
  if (normal.z() >= 0) return normal.normalized();
  normal.z() = 0;
  return normal.norm() > 1e-3 ? Vec3(normal.normalized()) : Vec3(Vec3::UnitZ());
}

}  // namespace

std::vector<Vec3> candidate_normals(const BaseComponent& base, int uniform) {
  std::vector<Vec3> normals{lifted(base.mean_normal), Vec3::UnitZ()};
  const Frame frame = Frame::along(normals.front());
  for (const double tilt : {15.0, 35.0}) {
    const double lean = tilt * std::numbers::pi / 180;
    for (int k = 0; k < 8; ++k) {
      const double turn = k * std::numbers::pi / 4;
      normals.push_back(lifted(frame.to_part(
          {std::sin(lean) * std::cos(turn), std::sin(lean) * std::sin(turn), std::cos(lean)})));
    }
  }
  const auto even = hemisphere_directions(uniform);
  normals.insert(normals.end(), even.begin(), even.end());
  return normals;
}

FirstChoice first_choice(const ClippingModel& model) {
  const auto& slots = model.slots();
  std::vector<std::size_t> required;
  for (std::size_t s = 0; s < slots.size(); ++s) {
    if (slots[s].required) required.push_back(s);
  }
  struct Candidate {
    std::size_t slot;
    std::shared_ptr<Cut> cut;
  };
  std::vector<Candidate> candidates;
  std::vector<CoverSet> sets;
  FirstChoice choice;
  choice.cuts.resize(slots.size());
  std::vector<bool> served(required.size(), false);
  for (std::size_t i = 0; i < required.size(); ++i) {
    const Slot& slot = slots[required[i]];
    for (const Vec3& normal : slot.normals) {
      auto cut = model.cut(required[i], {normal, model.highest_offset(slot, normal)});
      if (!cut) continue;
      CoverSet set;
      for (std::size_t k = 0; k < required.size(); ++k) {
        if (k == i || model.covers(*cut, slots[required[k]])) set.elements.push_back(k);
      }
      for (const auto element : set.elements) served[element] = true;
      set.weight =
          static_cast<double>(cut->taken.count()) / static_cast<double>(model.samples().size());
      sets.push_back(std::move(set));
      candidates.push_back({required[i], std::move(cut)});
    }
  }
  for (const auto chosen : cheapest_cover(required.size(), sets)) {
    choice.cuts[candidates[chosen].slot] = candidates[chosen].cut;
  }
  for (std::size_t i = 0; i < required.size(); ++i) {
    if (!served[i]) choice.unserved.push_back(required[i]);
  }
  return choice;
}

}  // namespace reforge

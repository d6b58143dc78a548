#include "planner/reuse/local_search.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <thread>

namespace reforge {
namespace {

constexpr double kPenaltyGrowth = 20;

class Chain {
 public:
  Chain(const ClippingModel& model, const SearchOptions& options, std::uint64_t seed)
      : model_(model), options_(options), random_(seed) {
    const auto samples = static_cast<double>(model.samples().size());
    penalty_at_start_ = std::max(10.0, 0.004 * samples);
    penalty_ = penalty_at_start_;
    hot_ = 0.012 * samples * options.heat;
    cold_ = 0.0003 * samples;
  }

  void run(Clipping state) {
    offer(state);
    for (int step = 0; step < options_.steps; ++step) {
      if (options_.should_stop && options_.should_stop()) return;
      const double done = static_cast<double>(step) / options_.steps;
      const double heat = hot_ * std::pow(cold_ / hot_, done);
      // In the end nothing out of reach is worth any volume.
      penalty_ = penalty_at_start_ * (1 + kPenaltyGrowth * done * done);
      const double threshold = energy_of(state) + heat * std::log(std::max(unit(), 1e-12));
      auto cuts = changed(state, done);
      if (cuts.empty()) continue;
      Clipping next = model_.combine(std::move(cuts), threshold);
      // Points out of reach only cost: without them the step must be good enough already.
      if (static_cast<double>(next.kept) - penalty_ * 10 * next.uncovered < threshold) continue;
      model_.count_blocked(next);
      if (energy_of(next) < threshold) continue;
      state = std::move(next);
      offer(state);
    }
  }

  std::vector<Clipping> found;  // each better than the one before

 private:
  double unit() { return static_cast<double>(random_() >> 11) * 0x1p-53; }
  double normal() {
    return std::sqrt(-2 * std::log(std::max(unit(), 1e-12))) *
           std::cos(2 * std::numbers::pi * unit());
  }
  double energy_of(const Clipping& state) const {
    return static_cast<double>(state.kept) - penalty_ * state.blocked -
           penalty_ * 10 * state.uncovered;
  }
  void offer(const Clipping& state) {
    if (!state.feasible()) return;
    if (found.empty() || state.kept > found.back().kept) found.push_back(state);
  }

  // One slot's plane changed; empty if the change came to nothing.
  std::vector<std::shared_ptr<Cut>> changed(const Clipping& state, double done) {
    const auto& slots = model_.slots();
    if (slots.empty()) return {};
    const std::size_t s = random_() % slots.size();
    const Slot& slot = slots[s];
    auto cuts = state.cuts;
    const double choice = unit();
    if (cuts[s] && choice < 0.08) {
      cuts[s] = nullptr;
      return cuts;
    }
    Plane plane;
    const double reach = 12 * options_.heat * (1 - done) + 0.5;  // mm
    if (!cuts[s] || choice < 0.3) {
      if (slot.normals.empty()) return {};
      plane.normal = slot.normals[random_() % slot.normals.size()];
      plane.offset = model_.highest_offset(slot, plane.normal) - reach * unit() * unit();
    } else if (choice < 0.65) {
      plane = cuts[s]->plane;
      const double depth = model_.highest_offset(slot, plane.normal) - plane.offset;
      const double spread = 0.5 * (1 - done) + 0.04;
      plane.normal += spread * Vec3(normal(), normal(), normal());
      if (plane.normal.z() < 0) plane.normal.z() = 0;
      if (plane.normal.norm() < 1e-3) return {};
      plane.normal.normalize();
      plane.offset = model_.highest_offset(slot, plane.normal) - depth;
    } else {
      plane = cuts[s]->plane;
      plane.offset += 0.3 * reach * normal();
    }
    if (!slot.points.empty()) {
      plane.offset = std::min(plane.offset, model_.highest_offset(slot, plane.normal));
    }
    auto cut = model_.cut(s, plane);
    if (!cut) return {};
    cuts[s] = std::move(cut);
    return cuts;
  }

  const ClippingModel& model_;
  const SearchOptions& options_;
  std::mt19937_64 random_;
  double penalty_at_start_, penalty_, hot_, cold_;
};

}  // namespace

std::vector<Clipping> local_search(const ClippingModel& model, const Clipping& start,
                                   const SearchOptions& options, std::size_t most) {
  std::vector<std::vector<Clipping>> found(static_cast<std::size_t>(options.chains));
  const auto work = [&](int from) {
    for (int c = from; c < options.chains; c += 2) {
      Chain chain(model, options, options.seed * 7919 + static_cast<std::uint64_t>(c));
      Clipping own = start;  // caps are made in place: no two threads share a cut
      for (auto& cut : own.cuts) {
        if (cut) cut = std::make_shared<Cut>(*cut);
      }
      chain.run(std::move(own));
      found[static_cast<std::size_t>(c)] = std::move(chain.found);
    }
  };
  std::thread other(work, 1);
  work(0);
  other.join();
  std::vector<Clipping> all;
  for (auto& chain : found) {
    for (auto& clipping : chain) all.push_back(std::move(clipping));
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Clipping& a, const Clipping& b) { return a.kept > b.kept; });
  if (all.size() > most) all.resize(most);
  return all;
}

}  // namespace reforge

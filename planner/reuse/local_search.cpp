#include "planner/reuse/local_search.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <thread>

namespace reforge {
namespace {

constexpr double kPenaltyGrowth = 20;
constexpr std::size_t kOwnNormals = 18;

class Chain {
 public:
  Chain(const ClippingModel& model, const SearchOptions& options, std::uint64_t seed)
      : model_(model), options_(options), random_(seed) {
    const auto samples = static_cast<double>(model.samples().size());
    penalty_at_start_ = std::max(10.0, 0.004 * samples);
    penalty_ = penalty_at_start_;
    hot_ = 0.012 * samples * options.heat;
    cold_ = 0.0003 * samples;
    for (const Slot& slot : model.slots()) {
      Vec3 sum = Vec3::Zero();
      for (const auto anchor : slot.anchors) sum += model.samples().points[anchor];
      centres_.push_back(sum / std::max<double>(1, static_cast<double>(slot.anchors.size())));
    }
  }

  void run(Clipping state) {
    model_.count_blocked(state, &last_);
    offer(state);
    state_changed(state);
    for (int step = 0; step < options_.steps; ++step) {
      if (options_.should_stop && options_.should_stop()) return;
      const double done = static_cast<double>(step) / options_.steps;
      const double heat = hot_ * std::pow(cold_ / hot_, done);
      // In the end nothing out of reach is worth any volume.
      penalty_ = penalty_at_start_ * (1 + kPenaltyGrowth * done * done);
      const double threshold = energy_of(state) + heat * std::log(std::max(unit(), 1e-12));
      auto cuts = changed(state, done);
      if (cuts.empty()) continue;
      ++volume_evaluations;
      Clipping next = model_.combine(std::move(cuts), threshold);
      // Points out of reach only cost: without them the step must be good enough already.
      if (static_cast<double>(next.kept) - penalty_ * 10 * next.uncovered < threshold) continue;
      ++feasibility_checks;
      model_.count_blocked(next, &last_);
      if (energy_of(next) < threshold) continue;
      state = std::move(next);
      offer(state);
      state_changed(state);
    }
  }

  std::vector<Clipping> found;  // each better than the one before
  long volume_evaluations = 0, feasibility_checks = 0;

 private:
  void state_changed(const Clipping& state) {
    blocked_known_ = state.blocked == 0;
    blocked_.clear();
  }
  // The slot to change: half of the time one near a point that is out of reach.
  std::size_t next_slot(const Clipping& state) {
    const auto count = model_.slots().size();
    if (state.blocked == 0 || unit() < 0.5) return random_() % count;
    if (!blocked_known_) {
      blocked_ = model_.out_of_reach(state);
      blocked_known_ = true;
    }
    if (blocked_.empty()) return random_() % count;
    const auto& place = blocked_[random_() % blocked_.size()];
    if (place.slot < count && unit() < 0.5) return place.slot;
    std::vector<std::pair<double, std::size_t>> near;
    for (std::size_t s = 0; s < count; ++s)
      near.emplace_back((centres_[s] - place.position).squaredNorm(), s);
    const std::size_t among = std::min<std::size_t>(4, count);
    std::partial_sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(among), near.end());
    return near[random_() % among].second;
  }
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
    const std::size_t s = next_slot(state);
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
      // The first few are the base's own (candidate_planes.h), the others even over the hemisphere.
      const std::size_t own = std::min(slot.normals.size(), kOwnNormals);
      plane.normal = slot.normals[random_() % (unit() < 0.75 ? own : slot.normals.size())];
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
  LastServed last_;
  std::vector<Vec3> centres_;  // of the slots
  std::vector<ClippingModel::OutOfReach> blocked_;
  bool blocked_known_ = false;
};

}  // namespace

SearchResult local_search(const ClippingModel& model, const std::vector<Clipping>& starts,
                          const SearchOptions& options, std::size_t most) {
  std::vector<SearchResult> results(static_cast<std::size_t>(options.chains));
  const auto work = [&](int from) {
    for (int c = from; c < options.chains; c += 2) {
      Chain chain(model, options, options.seed * 7919 + static_cast<std::uint64_t>(c));
      Clipping own = starts[static_cast<std::size_t>(c) % starts.size()];
      for (auto& cut : own.cuts) {  // caps are made in place: no two threads share a cut
        if (cut) cut = std::make_shared<Cut>(*cut);
      }
      chain.run(std::move(own));
      results[static_cast<std::size_t>(c)] = {std::move(chain.found), chain.volume_evaluations,
                                              chain.feasibility_checks};
    }
  };
  std::thread other(work, 1);
  work(0);
  other.join();
  SearchResult all;
  for (SearchResult& result : results) {
    all.volume_evaluations += result.volume_evaluations;
    all.feasibility_checks += result.feasibility_checks;
    for (auto& clipping : result.found) all.found.push_back(std::move(clipping));
  }
  std::stable_sort(all.found.begin(), all.found.end(),
                   [](const Clipping& a, const Clipping& b) { return a.kept > b.kept; });
  if (all.found.size() > most) all.found.resize(most);
  return all;
}

}  // namespace reforge

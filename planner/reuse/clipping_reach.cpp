// Reach: which watched points and caps a clipping leaves blocked.
#include <algorithm>
#include <cmath>

#include "planner/reuse/clipping.h"

namespace reforge {
namespace {

constexpr double kBelowBase = 1e-6;   // mm of rounding allowed under z = 0
constexpr double kCapSpacing = 1.5;   // mm
constexpr std::size_t kLeaning = 12;  // directions tried for milling a cap, besides its normal

bool any_clear(const std::vector<Blockers>& alternatives, const BitSet& taken) {
  return std::any_of(alternatives.begin(), alternatives.end(),
                     [&](const Blockers& blockers) { return blockers.clear(taken); });
}

struct Near {
  float u, v, h;
  std::uint32_t number;
};

}  // namespace

ClippingModel::Tools ClippingModel::widened(double extra_mm) const {
  const double by = options_.clearance_mm + extra_mm, lower = options_.lowered_mm + extra_mm;
  return {ToolProfile(tools_.cutter, by, lower), ToolProfile(tools_.nozzle, by, lower)};
}

bool ClippingModel::fixture_blocks(std::span<const ToolSection> sections, const Vec3& tip,
                                   const Vec3& direction) const {
  if (tip.z() < -kBelowBase) return true;
  return std::any_of(fixture_points_.begin(), fixture_points_.end(), [&](const Vec3& point) {
    return body_holds(sections, tip, direction, point);
  });
}

bool ClippingModel::fixture_blocks(bool cutter, const Vec3& tip, std::size_t direction) const {
  if (tip.z() < -kBelowBase) return true;
  if (past_fixture_.empty()) return false;
  const DirectionalReach& past = past_fixture_[direction];
  return cutter ? !past.cutter_reaches(tip + tools_.ball_radius_mm * directions_[direction])
                : !past.nozzle_reaches(tip);
}

void ClippingModel::watch_point(const SurfaceSample& sample, bool always_goes, bool cutter,
                                double extra_mm) {
  const bool staying = cutter ? sample.needs_cutter(false) : sample.needs_nozzle(false);
  const Tools tools = widened(extra_mm);
  const ToolProfile& tool = cutter ? tools.cutter : tools.nozzle;
  WatchedPoint point{sample, -1, always_goes, cutter, {}};
  if (sample.borders_reused()) {
    point.matter = sample_near(sample.position - 0.5 * samples_.grid.pitch_mm * sample.normal);
  }
  std::vector<Vec3> places{sample.position};
  if (cutter) places = ball_centres(sample, !staying || always_goes, tools_.ball_radius_mm);
  struct Way {
    std::size_t count, direction;
    Vec3 tip;
  };
  std::vector<Way> ways;
  for (std::size_t d = 0; d < directions_.size(); ++d) {
    for (const Vec3& place : places) {
      const Vec3 tip = cutter ? Vec3(place - tools_.ball_radius_mm * directions_[d]) : place;
      if (tip.z() < -kBelowBase) continue;
      ways.push_back({directed_[d].least(tool, tip), d, tip});
    }
  }
  const auto fewer = [](const Way& a, const Way& b) { return a.count < b.count; };
  std::stable_sort(ways.begin(), ways.end(), fewer);
  // The least blocked ways; one whose lower bound is no better than those found need not be
  // counted.
  std::vector<Way> best;
  std::size_t worst = samples_.size();
  for (Way& way : ways) {
    const bool full = best.size() >= options_.directions_kept;
    if (full && way.count >= worst) break;
    if (fixture_blocks(cutter, way.tip, way.direction)) continue;
    way.count = directed_[way.direction].count(tool, way.tip, worst);
    if (full && way.count >= worst) continue;
    best.insert(std::upper_bound(best.begin(), best.end(), way, fewer), way);
    if (best.size() > options_.directions_kept) best.pop_back();
    if (best.size() >= options_.directions_kept) worst = best.back().count;
  }
  for (const Way& way : best) {
    point.blockers.emplace_back(directed_[way.direction].find(tool, way.tip));
  }
  watched_.push_back(std::move(point));
}

void ClippingModel::watch(const std::vector<SurfaceSample>& samples, const ReachTable& reach) {
  const auto gone = required_origins();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const SurfaceSample& sample = samples[i];
    for (const bool cutter : {true, false}) {
      if ((cutter ? reach.cutter_anywhere : reach.nozzle_anywhere).test(i)) continue;
      const bool staying = cutter ? sample.needs_cutter(false) : sample.needs_nozzle(false);
      const bool going = sample.borders_reused() &&
                         (cutter ? sample.needs_cutter(true) : sample.needs_nozzle(true));
      if (staying || going)
        watch_point(sample, gone.count(sample.origin) > 0, cutter, options_.watched_extra_mm);
    }
  }
}

void ClippingModel::watch_closely(const std::vector<SurfaceSample>& samples, double extra_mm) {
  const auto gone = required_origins();
  for (const SurfaceSample& sample : samples) {
    for (const bool cutter : {true, false}) {
      const bool staying = cutter ? sample.needs_cutter(false) : sample.needs_nozzle(false);
      const bool going = sample.borders_reused() &&
                         (cutter ? sample.needs_cutter(true) : sample.needs_nozzle(true));
      if (staying || going) watch_point(sample, gone.count(sample.origin) > 0, cutter, extra_mm);
    }
  }
}

// Where a cap may be milled from besides its normal: the nearest of the common directions.
std::vector<std::size_t> ClippingModel::leaning_towards(const Vec3& normal) const {
  std::vector<std::size_t> leaning;
  for (std::size_t d = 0; d < directions_.size(); ++d) {
    if (directions_[d].dot(normal) > 0.05) leaning.push_back(d);
  }
  std::stable_sort(leaning.begin(), leaning.end(), [&](std::size_t a, std::size_t b) {
    return directions_[a].dot(normal) + directions_[a].z() >
           directions_[b].dot(normal) + directions_[b].z();
  });
  if (leaning.size() > kLeaning) leaning.resize(kLeaning);
  return leaning;
}

void ClippingModel::make_caps(Cut& cut) const {
  cut.caps_made = true;
  const double pitch = samples_.grid.pitch_mm;
  const Vec3 n = cut.plane.normal;
  const Frame frame = Frame::along(n);
  const Eigen::Vector3f u = frame.u.cast<float>(), v = frame.v.cast<float>(), up = n.cast<float>();
  const auto offset = static_cast<float>(cut.plane.offset);
  // One cap point in each cell of a raster on the plane, beneath what is taken and on what is not.
  struct Candidate {
    std::int64_t cell;
    std::uint32_t beneath;
    Vec3 at;
  };
  std::vector<Candidate> candidates;
  const auto layer = static_cast<float>(pitch * n.cwiseAbs().maxCoeff());
  for (std::size_t w = 0; w < cut.taken.words.size(); ++w) {
    for (std::uint64_t bits = cut.taken.words[w]; bits; bits &= bits - 1) {
      const auto i =
          static_cast<std::uint32_t>(64 * w) + static_cast<std::uint32_t>(std::countr_zero(bits));
      const float above = up.dot(points_[i]) - offset;
      if (above > layer) continue;
      const Vec3 at = samples_.points[i] - static_cast<double>(above) * n;
      std::int32_t beneath = samples_.number_at(at - 0.6 * pitch * n);
      if (beneath < 0 || cut.taken.test(static_cast<std::uint32_t>(beneath))) {
        beneath = -1;
        float nearest = 1e30f;
        for (const auto next : samples_.neighbours[i]) {
          if (next < 0 || cut.taken.test(static_cast<std::uint32_t>(next))) continue;
          if (up.dot(points_[static_cast<std::size_t>(next)]) > offset) continue;
          const float distance =
              (points_[static_cast<std::size_t>(next)] - at.cast<float>()).squaredNorm();
          if (distance >= nearest) continue;
          nearest = distance;
          beneath = next;
        }
      }
      if (beneath < 0) continue;
      const auto cell = [](double x) {
        return static_cast<std::int64_t>(std::floor(x / kCapSpacing));
      };
      candidates.push_back({cell(frame.u.dot(at)) * 0x1000000 + cell(frame.v.dot(at)),
                            static_cast<std::uint32_t>(beneath), at});
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.cell < b.cell; });
  candidates.erase(
      std::unique(candidates.begin(), candidates.end(),
                  [](const Candidate& a, const Candidate& b) { return a.cell == b.cell; }),
      candidates.end());
  if (candidates.empty()) return;

  // What stands beyond the plane.
  const Tools tools = widened(cap_extra_[cut.slot]);
  Eigen::AlignedBox2f reach;
  for (const Candidate& candidate : candidates) {
    const Eigen::Vector3f at = candidate.at.cast<float>();
    reach.extend(Eigen::Vector2f(u.dot(at), v.dot(at)));
  }
  const float widest = std::max(tools.cutter.widest, tools.nozzle.widest);
  reach.extend((reach.min().array() - widest).matrix().eval());
  reach.extend((reach.max().array() + widest).matrix().eval());
  BitSet above_all(samples_.size());
  std::vector<Near> near;
  for (std::uint32_t i = 0; i < points_.size(); ++i) {
    const float h = up.dot(points_[i]) - offset;
    if (h <= 0 || cut.taken.test(i)) continue;
    if (h > tools.nozzle.infinite_from) above_all.set(i);
    const Near sample{u.dot(points_[i]), v.dot(points_[i]), h, i};
    if (reach.contains(Eigen::Vector2f(sample.u, sample.v)) || h > tools.cutter.infinite_from)
      near.push_back(sample);
  }
  cut.above_caps = Blockers(above_all);
  const bool nozzle_suffices = tools.cutter.within(tools.nozzle) && fixture_points_.empty();
  std::vector<std::size_t> leaning;
  if (!nozzle_suffices) leaning = leaning_towards(n);
  BitSet found(samples_.size());
  const auto in_the_way = [&](const ToolProfile& tool, const Candidate& candidate, float up_to) {
    const Eigen::Vector3f at = candidate.at.cast<float>();
    const float cu = u.dot(at), cv = v.dot(at);
    std::fill(found.words.begin(), found.words.end(), 0);
    for (const Near& sample : near) {
      if (sample.h > up_to) continue;
      const float du = sample.u - cu, dv = sample.v - cv;
      if (tool.holds(sample.h, du * du + dv * dv)) found.set(sample.number);
    }
    return Blockers(found);
  };
  for (const Candidate& candidate : candidates) {
    CapPoint cap{candidate.at, candidate.beneath, {}, {}};
    if (fixture_blocks(wide_tools_.nozzle, candidate.at, n)) {
      cap.nozzle_blockers = Blockers(all_);
    } else {
      cap.nozzle_blockers = in_the_way(tools.nozzle, candidate, tools.nozzle.infinite_from);
    }
    if (!nozzle_suffices) {
      // Along the normal the ball's tip is the cap point itself.
      if (!fixture_blocks(wide_tools_.cutter, candidate.at, n))
        cap.cutter_blockers.push_back(in_the_way(tools.cutter, candidate, 1e30f));
      const Vec3 centre = candidate.at + tools_.ball_radius_mm * n;
      for (const auto d : leaning) {
        if (!cap.cutter_blockers.empty() && !cap.cutter_blockers.back().any()) break;
        const Vec3 tip = centre - tools_.ball_radius_mm * directions_[d];
        if (fixture_blocks(true, tip, d)) continue;
        BitSet blocking = directed_[d].find(tools.cutter, tip);
        blocking.subtract(cut.taken);
        cap.cutter_blockers.emplace_back(blocking);
      }
      if (cap.cutter_blockers.empty()) cap.cutter_blockers.emplace_back(all_);
      // One that nothing can block again is enough.
      if (!cap.cutter_blockers.back().any()) cap.cutter_blockers = {Blockers()};
    }
    cut.caps.push_back(std::move(cap));
  }
}

bool ClippingModel::is_wanted(const WatchedPoint& point, const BitSet& taken) const {
  const bool goes = point.always_goes ||
                    (point.matter >= 0 && taken.test(static_cast<std::uint32_t>(point.matter)));
  return point.cutter ? point.sample.needs_cutter(goes) : point.sample.needs_nozzle(goes);
}

bool ClippingModel::is_served(const WatchedPoint& point, const BitSet& taken,
                              std::uint16_t* last) const {
  if (last && *last < point.blockers.size() && point.blockers[*last].clear(taken)) return true;
  for (std::size_t w = 0; w < point.blockers.size(); ++w) {
    if (!point.blockers[w].clear(taken)) continue;
    if (last) *last = static_cast<std::uint16_t>(w);
    return true;
  }
  return false;
}

void ClippingModel::count_blocked(Clipping& clipping, LastServed* last) const {
  clipping.blocked = 0;
  if (last) last->resize(watched_.size());
  for (std::size_t i = 0; i < watched_.size(); ++i) {
    if (!is_wanted(watched_[i], clipping.taken)) continue;
    clipping.blocked += !is_served(watched_[i], clipping.taken, last ? &(*last)[i] : nullptr);
  }
  for (const auto& cut : clipping.cuts) {
    if (!cut) continue;
    if (!cut->caps_made) make_caps(*cut);
    const bool above_clear = cut->above_caps.clear(clipping.taken);
    for (const CapPoint& cap : cut->caps) {
      if (clipping.taken.test(cap.beneath)) continue;
      clipping.blocked += !above_clear || !cap.nozzle_blockers.clear(clipping.taken);
      clipping.blocked +=
          !cap.cutter_blockers.empty() && !any_clear(cap.cutter_blockers, clipping.taken);
    }
  }
}

std::vector<ClippingModel::OutOfReach> ClippingModel::out_of_reach(const Clipping& clipping) const {
  std::vector<OutOfReach> places;
  for (const WatchedPoint& point : watched_) {
    if (!is_wanted(point, clipping.taken) || is_served(point, clipping.taken, nullptr)) continue;
    places.push_back({point.sample.position, slots_.size()});
  }
  for (const auto& cut : clipping.cuts) {
    if (!cut || !cut->caps_made) continue;
    const bool above_clear = cut->above_caps.clear(clipping.taken);
    for (const CapPoint& cap : cut->caps) {
      if (clipping.taken.test(cap.beneath)) continue;
      const bool printed = above_clear && cap.nozzle_blockers.clear(clipping.taken);
      const bool milled =
          cap.cutter_blockers.empty() || any_clear(cap.cutter_blockers, clipping.taken);
      if (!printed || !milled) places.push_back({cap.position, cut->slot});
    }
  }
  return places;
}

}  // namespace reforge

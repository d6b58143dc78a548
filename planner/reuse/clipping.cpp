#include "planner/reuse/clipping.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <unordered_set>

namespace reforge {
namespace {

constexpr double kBelowBase = 1e-6;    // mm of rounding allowed under z = 0
constexpr double kBelowPoints = 0.02;  // mm a plane stays below the points it must take
constexpr double kCapSpacing = 1.5;    // mm
constexpr double kFixturePitch = 1;    // mm
constexpr double kFixtureSpacing = 3;  // mm
constexpr std::size_t kLeaning = 12;   // directions tried for milling a cap, besides its normal

std::vector<ToolSection> widened(std::vector<ToolSection> sections, double by) {
  for (ToolSection& section : sections) {
    section.r_from_mm += by;
    section.r_to_mm += by;
  }
  return sections;
}

// Points on every triangle, no farther apart than the spacing.
std::vector<Vec3> points_on(const TriangleMesh& mesh, double spacing) {
  std::vector<Vec3> points;
  for (const auto& [ia, ib, ic] : mesh.triangles) {
    const Vec3 &a = mesh.vertices[ia], &b = mesh.vertices[ib], &c = mesh.vertices[ic];
    const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
    const int steps = std::max(1, static_cast<int>(std::ceil(longest / spacing)));
    for (int i = 0; i <= steps; ++i) {
      for (int j = 0; i + j <= steps; ++j) {
        points.push_back(a + (b - a) * i / steps + (c - a) * j / steps);
      }
    }
  }
  return points;
}

bool any_clear(const std::vector<Blockers>& alternatives, const BitSet& taken) {
  return std::any_of(alternatives.begin(), alternatives.end(),
                     [&](const Blockers& blockers) { return blockers.clear(taken); });
}

}  // namespace

Blockers::Blockers(const BitSet& set) {
  std::size_t end = set.words.size();
  while (end > 0 && set.words[end - 1] == 0) --end;
  while (first_word < end && set.words[first_word] == 0) ++first_word;
  words.assign(set.words.begin() + static_cast<std::ptrdiff_t>(first_word),
               set.words.begin() + static_cast<std::ptrdiff_t>(end));
}

ClippingModel::ClippingModel(const TriangleMesh& reused, double pitch_mm, const ToolBodies& tools,
                             const TriangleMesh& fixture, std::vector<Vec3> directions,
                             const ClippingOptions& options)
    : samples_(sample(reused, VoxelGrid::over(bounds(reused), pitch_mm))),
      all_(samples_.size()),
      foot_(samples_.size()),
      tools_{tools.ball_radius_mm, widened(tools.cutter, options.clearance_mm),
             widened(tools.nozzle, options.clearance_mm)},
      fixture_points_(points_on(fixture, kFixtureSpacing)),
      directions_(std::move(directions)),
      options_(options) {
  for (std::uint32_t i = 0; i < samples_.size(); ++i) {
    all_.set(i);
    if (samples_.points[i].z() < pitch_mm) {
      foot_.set(i);
      foot_list_.push_back(i);
    }
  }
  const BitSet none(samples_.size());
  for (const Vec3& direction : directions_)
    projections_.push_back(project(direction, none, -1e300));
  if (fixture.empty()) return;
  const TriangleMesh* obstacles[] = {&fixture};
  for (const Vec3& direction : directions_) {
    past_fixture_.emplace_back(direction, obstacles, samples_.points, tools_, kFixturePitch);
  }
}

std::int32_t ClippingModel::sample_near(const Vec3& point) const {
  const double pitch = samples_.grid.pitch_mm;
  std::int32_t best = -1;
  double nearest = std::numeric_limits<double>::infinity();
  for (int n = 0; n < 125; ++n) {
    const Vec3 at = point + pitch * Vec3(n % 5 - 2, n / 5 % 5 - 2, n / 25 - 2);
    const auto number = samples_.number_at(at);
    if (number < 0) continue;
    const double distance =
        (samples_.points[static_cast<std::size_t>(number)] - point).squaredNorm();
    if (distance < nearest) {
      nearest = distance;
      best = number;
    }
  }
  return best;
}

void ClippingModel::add_base(const BaseComponent& base, const std::vector<Vec3>& normals) {
  Slot slot;
  slot.points = base.points;
  slot.origins = base.origins;
  slot.normals = normals;
  slot.required = !base.plano_convex;
  for (const Vec3& point : base.points) {
    const auto number = sample_near(point - 0.5 * samples_.grid.pitch_mm * base.mean_normal);
    if (number >= 0) slot.anchors.push_back(static_cast<std::uint32_t>(number));
  }
  std::sort(slot.anchors.begin(), slot.anchors.end());
  slot.anchors.erase(std::unique(slot.anchors.begin(), slot.anchors.end()), slot.anchors.end());
  slots_.push_back(std::move(slot));
}

void ClippingModel::require(const std::vector<std::uint32_t>& origins) {
  for (Slot& slot : slots_) {
    slot.required |= std::any_of(origins.begin(), origins.end(), [&](std::uint32_t origin) {
      return std::binary_search(slot.origins.begin(), slot.origins.end(), origin);
    });
  }
}

void ClippingModel::add_blocker_slots(std::size_t most) {
  constexpr double kApart = 8;  // mm
  std::vector<Vec3> served;
  for (const WatchedPoint& point : watched_) {
    if (served.size() >= most) return;
    if (point.blockers.empty()) continue;
    if (point.always_goes) continue;
    if (!(point.cutter ? point.sample.needs_cutter(false) : point.sample.needs_nozzle(false))) {
      continue;
    }
    const bool near = std::any_of(served.begin(), served.end(), [&](const Vec3& other) {
      return (other - point.sample.position).norm() < kApart;
    });
    if (near) continue;
    served.push_back(point.sample.position);
    Slot slot;
    const Blockers& least = point.blockers.front();
    for (std::size_t w = 0; w < least.words.size(); ++w) {
      for (std::uint32_t bit = 0; bit < 64; ++bit) {
        if (!(least.words[w] >> bit & 1)) continue;
        slot.anchors.push_back(static_cast<std::uint32_t>(64 * (least.first_word + w)) + bit);
      }
    }
    slot.normals = {Vec3::UnitZ()};
    for (const Vec3& d : directions_) {
      if (d.dot(point.sample.normal) > 0.3) slot.normals.push_back(d);
    }
    slots_.push_back(std::move(slot));
  }
}

void ClippingModel::add_top_slot() {
  Slot slot;
  slot.anchors.resize(samples_.size());
  std::iota(slot.anchors.begin(), slot.anchors.end(), 0u);
  slot.normals = {Vec3::UnitZ()};
  slots_.push_back(std::move(slot));
}

ClippingModel::Projection ClippingModel::project(const Vec3& direction, const BitSet& without,
                                                 double above) const {
  Projection result;
  result.frame = Frame::along(direction);
  std::vector<std::pair<float, std::uint32_t>> order;
  for (std::uint32_t i = 0; i < samples_.size(); ++i) {
    const double height = samples_.points[i].dot(direction);
    if (height <= above || without.test(i)) continue;
    order.emplace_back(static_cast<float>(height), i);
  }
  std::sort(order.begin(), order.end());
  for (const auto& [height, i] : order) {
    const Vec3 local = result.frame.to_local(samples_.points[i]);
    result.u.push_back(static_cast<float>(local.x()));
    result.v.push_back(static_cast<float>(local.y()));
    result.h.push_back(height);
    result.number.push_back(i);
  }
  return result;
}

BitSet ClippingModel::blockers(const std::vector<ToolSection>& sections, const Vec3& tip,
                               const Projection& along) const {
  BitSet found(samples_.size());
  const Vec3 local = along.frame.to_local(tip);
  const auto u = static_cast<float>(local.x()), v = static_cast<float>(local.y());
  // Cones are taken at their wider end: bodies are widened while searching anyway.
  double widest = 0;
  std::size_t i = 0;
  for (std::size_t k = 0; k < sections.size(); ++k) {
    const auto from = static_cast<float>(local.z() + sections[k].z_from_mm);
    i = static_cast<std::size_t>(std::upper_bound(along.h.begin(), along.h.end(), from) -
                                 along.h.begin());
    widest = std::max({widest, sections[k].r_from_mm, sections[k].r_to_mm});
    std::size_t end = along.h.size();
    if (k + 1 < sections.size()) {
      const auto to = static_cast<float>(local.z() + sections[k + 1].z_from_mm);
      end = static_cast<std::size_t>(std::upper_bound(along.h.begin(), along.h.end(), to) -
                                     along.h.begin());
    }
    const auto square = static_cast<float>(widest * widest);
    for (; i < end; ++i) {
      const float du = along.u[i] - u, dv = along.v[i] - v;
      if (du * du + dv * dv < square) found.set(along.number[i]);
    }
  }
  return found;
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

void ClippingModel::watch(const std::vector<SurfaceSample>& samples, const ReachTable& reach,
                          bool assume_blocked) {
  std::unordered_set<std::uint32_t> on_required;
  for (const Slot& slot : slots_) {
    if (slot.required) on_required.insert(slot.origins.begin(), slot.origins.end());
  }
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const SurfaceSample& sample = samples[i];
    const bool always_goes = on_required.count(sample.origin) > 0;
    const double r = tools_.ball_radius_mm;
    for (const bool cutter : {true, false}) {
      const bool staying =
          !always_goes && (cutter ? sample.needs_cutter(false) : sample.needs_nozzle(false));
      const bool going = sample.borders_reused() &&
                         (cutter ? sample.needs_cutter(true) : sample.needs_nozzle(true));
      if (!staying && !going) continue;
      if (!assume_blocked && (cutter ? reach.cutter_anywhere : reach.nozzle_anywhere).test(i))
        continue;
      WatchedPoint point{sample, -1, always_goes, cutter, {}};
      if (sample.borders_reused()) {
        point.matter = sample_near(sample.position - 0.5 * samples_.grid.pitch_mm * sample.normal);
      }
      const auto& sections = cutter ? tools_.cutter : tools_.nozzle;
      std::vector<std::pair<std::size_t, BitSet>> found;
      for (std::size_t d = 0; d < directions_.size(); ++d) {
        const Vec3& direction = directions_[d];
        std::vector<Vec3> tips{sample.position};
        if (cutter) {
          tips = ball_centres(sample, !staying, r);
          for (Vec3& tip : tips) tip -= r * direction;
        }
        for (const Vec3& tip : tips) {
          if (fixture_blocks(cutter, tip, d)) continue;
          BitSet set = blockers(sections, tip, projections_[d]);
          found.emplace_back(set.count(), std::move(set));
        }
      }
      std::stable_sort(found.begin(), found.end(),
                       [](const auto& a, const auto& b) { return a.first < b.first; });
      if (found.size() > options_.directions_kept) found.resize(options_.directions_kept);
      for (auto& [count, set] : found) point.blockers.emplace_back(set);
      watched_.push_back(std::move(point));
    }
  }
}

double ClippingModel::highest_offset(const Slot& slot, const Vec3& normal) const {
  double lowest = std::numeric_limits<double>::infinity();
  for (const Vec3& point : slot.points) lowest = std::min(lowest, normal.dot(point));
  if (!slot.points.empty()) return lowest - kBelowPoints;
  if (slot.anchors.size() == samples_.size()) {
    double top = -lowest;
    for (const Vec3& point : samples_.points) top = std::max(top, normal.dot(point));
    return top;
  }
  for (const auto anchor : slot.anchors)
    lowest = std::min(lowest, normal.dot(samples_.points[anchor]));
  return lowest - samples_.grid.pitch_mm / 2;
}

std::shared_ptr<Cut> ClippingModel::cut(std::size_t slot, const Plane& plane) const {
  // Matter thinner than a voxel connects too: the flood runs through samples just below the plane.
  const double thin = 0.87 * samples_.grid.pitch_mm;
  BitSet beyond(samples_.size()), connecting(samples_.size());
  for (std::uint32_t i = 0; i < samples_.size(); ++i) {
    const double above = plane.signed_distance(samples_.points[i]);
    if (above > 0) beyond.set(i);
    if (above > -thin) connecting.set(i);
  }
  auto result = std::make_shared<Cut>();
  result->plane = plane;
  result->taken = flood(samples_, slots_[slot].anchors, connecting, Connectivity::kCorners);
  result->taken &= beyond;
  BitSet foot = foot_;
  foot &= result->taken;
  if (static_cast<double>(foot.count()) >
      (1 - options_.foot_kept) * static_cast<double>(foot_list_.size())) {
    return nullptr;
  }
  return result->taken.any() ? result : nullptr;
}

bool ClippingModel::covers(const Cut& cut, const Slot& slot) const {
  for (const Vec3& point : slot.points) {
    if (cut.plane.signed_distance(point) < kBelowPoints / 2) return false;
  }
  // An anchor just below the plane may stay; one beyond it must be among what is taken.
  for (const auto anchor : slot.anchors) {
    if (!cut.taken.test(anchor) && cut.plane.signed_distance(samples_.points[anchor]) > 0)
      return false;
  }
  return true;
}

Clipping ClippingModel::combine(std::vector<std::shared_ptr<Cut>> cuts, double needed) const {
  Clipping clipping;
  clipping.cuts = std::move(cuts);
  clipping.taken = BitSet(samples_.size());
  for (const auto& cut : clipping.cuts) {
    if (cut) clipping.taken |= cut->taken;
  }
  BitSet left = all_;
  left.subtract(clipping.taken);
  clipping.kept = left.count();
  if (static_cast<double>(clipping.kept) < needed) return clipping;
  const BitSet standing = flood(samples_, foot_list_, left, Connectivity::kFaces);
  clipping.taken = all_;
  clipping.taken.subtract(standing);
  clipping.kept = standing.count();
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    if (!slots_[s].required || clipping.cuts[s]) continue;
    const bool covered =
        std::any_of(clipping.cuts.begin(), clipping.cuts.end(),
                    [&](const auto& cut) { return cut && covers(*cut, slots_[s]); });
    clipping.uncovered += !covered;
  }
  // A foot of which too little is left holds nothing.
  BitSet foot = foot_;
  foot &= standing;
  if (static_cast<double>(foot.count()) <
      options_.foot_kept * static_cast<double>(foot_list_.size())) {
    ++clipping.uncovered;
  }
  return clipping;
}

void ClippingModel::make_caps(Cut& cut) const {
  cut.caps_made = true;
  const double pitch = samples_.grid.pitch_mm;
  const Vec3 n = cut.plane.normal;
  const Projection beyond = project(n, cut.taken, cut.plane.offset);
  const Frame& frame = beyond.frame;
  // Where a cap may be milled from: along its normal, else the nearest of the common directions.
  std::vector<std::size_t> leaning;
  for (std::size_t d = 0; d < directions_.size(); ++d) {
    if (directions_[d].dot(n) > 0.05) leaning.push_back(d);
  }
  std::stable_sort(leaning.begin(), leaning.end(), [&](std::size_t a, std::size_t b) {
    return directions_[a].dot(n) + directions_[a].z() > directions_[b].dot(n) + directions_[b].z();
  });
  if (leaning.size() > kLeaning) leaning.resize(kLeaning);
  std::unordered_set<std::uint64_t> used;  // asked only whether a place is taken
  for (std::uint32_t i = 0; i < samples_.size(); ++i) {
    if (!cut.taken.test(i)) continue;
    const double above = cut.plane.signed_distance(samples_.points[i]);
    if (above > pitch * n.cwiseAbs().maxCoeff()) continue;
    const Vec3 at = samples_.points[i] - above * n;
    const auto beneath = sample_near(at - 0.6 * pitch * n);
    if (beneath < 0 || cut.taken.test(static_cast<std::uint32_t>(beneath))) continue;
    const Vec3 local = frame.to_local(at);
    const auto cell = [](double x) {
      return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(x / kCapSpacing)) +
                                        (1 << 20));
    };
    if (!used.insert(cell(local.x()) << 32 | cell(local.y())).second) continue;
    CapPoint cap{static_cast<std::uint32_t>(beneath), {}, {}};
    if (fixture_blocks(tools_.nozzle, at, n)) {
      cap.nozzle_blockers = Blockers(all_);
    } else {
      cap.nozzle_blockers = Blockers(blockers(tools_.nozzle, at, beyond));
    }
    // Along the normal the ball's tip is the cap point itself.
    const bool free_of_fixture = !fixture_blocks(tools_.cutter, at, n);
    if (free_of_fixture) cap.cutter_blockers.emplace_back(blockers(tools_.cutter, at, beyond));
    const Vec3 centre = at + tools_.ball_radius_mm * n;
    for (const auto d : leaning) {
      if (!cap.cutter_blockers.empty() && !cap.cutter_blockers.back().any()) break;
      const Vec3 tip = centre - tools_.ball_radius_mm * directions_[d];
      if (fixture_blocks(true, tip, d)) continue;
      BitSet blocking = blockers(tools_.cutter, tip, projections_[d]);
      blocking.subtract(cut.taken);
      cap.cutter_blockers.emplace_back(blocking);
    }
    // One that nothing can block again is enough.
    if (!cap.cutter_blockers.empty() && !cap.cutter_blockers.back().any()) {
      cap.cutter_blockers = {cap.cutter_blockers.back()};
    }
    cut.caps.push_back(std::move(cap));
  }
}

void ClippingModel::count_blocked(Clipping& clipping) const {
  clipping.blocked = 0;
  for (const WatchedPoint& point : watched_) {
    const bool goes =
        point.always_goes ||
        (point.matter >= 0 && clipping.taken.test(static_cast<std::uint32_t>(point.matter)));
    if (!(point.cutter ? point.sample.needs_cutter(goes) : point.sample.needs_nozzle(goes)))
      continue;
    clipping.blocked += !any_clear(point.blockers, clipping.taken);
  }
  for (const auto& cut : clipping.cuts) {
    if (!cut) continue;
    if (!cut->caps_made) make_caps(*cut);
    for (const CapPoint& cap : cut->caps) {
      if (clipping.taken.test(cap.beneath)) continue;
      clipping.blocked += !cap.nozzle_blockers.clear(clipping.taken);
      clipping.blocked += !any_clear(cap.cutter_blockers, clipping.taken);
    }
  }
}

}  // namespace reforge

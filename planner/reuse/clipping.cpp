#include "planner/reuse/clipping.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace reforge {
namespace {

constexpr double kBelowPoints = 0.02;  // mm a plane stays below the points it must take
constexpr double kFixturePitch = 1;    // mm
constexpr double kFixtureSpacing = 3;  // mm

std::vector<ToolSection> widened_sections(std::vector<ToolSection> sections, double by) {
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

}  // namespace

ClippingModel::ClippingModel(const TriangleMesh& reused, double pitch_mm, const ToolBodies& tools,
                             const TriangleMesh& fixture, std::vector<Vec3> directions,
                             const ClippingOptions& options)
    : samples_(sample(reused, VoxelGrid::over(bounds(reused), pitch_mm))),
      runs_(samples_),
      all_(samples_.size()),
      foot_(samples_.size()),
      tools_(tools),
      wide_tools_{tools.ball_radius_mm, widened_sections(tools.cutter, options.clearance_mm),
                  widened_sections(tools.nozzle, options.clearance_mm)},
      fixture_points_(points_on(fixture, kFixtureSpacing)),
      directions_(std::move(directions)),
      options_(options) {
  for (std::uint32_t i = 0; i < samples_.size(); ++i) {
    all_.set(i);
    points_.push_back(samples_.points[i].cast<float>());
    if (samples_.points[i].z() < pitch_mm) {
      foot_.set(i);
      foot_list_.push_back(i);
    }
  }
  foot_seeds_ = runs_.seeds_at(foot_list_);
  for (const Vec3& direction : directions_) directed_.emplace_back(samples_, direction);
  if (fixture.empty()) return;
  const TriangleMesh* obstacles[] = {&fixture};
  for (const Vec3& direction : directions_) {
    past_fixture_.emplace_back(direction, obstacles, samples_.points, wide_tools_, kFixturePitch);
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
  cap_extra_.push_back(0);
  anchor_seeds_.push_back(runs_.seeds_at(slots_.back().anchors));
}

void ClippingModel::require(const std::vector<std::uint32_t>& origins) {
  for (Slot& slot : slots_) {
    slot.required |= std::any_of(origins.begin(), origins.end(), [&](std::uint32_t origin) {
      return std::binary_search(slot.origins.begin(), slot.origins.end(), origin);
    });
  }
  const auto gone = required_origins();
  for (WatchedPoint& point : watched_) point.always_goes = gone.count(point.sample.origin) > 0;
}

std::unordered_set<std::uint32_t> ClippingModel::required_origins() const {
  std::unordered_set<std::uint32_t> origins;  // only asked what it holds
  for (const Slot& slot : slots_) {
    if (slot.required) origins.insert(slot.origins.begin(), slot.origins.end());
  }
  return origins;
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
    for (const auto& word : least.words) {
      for (std::uint32_t bit = 0; bit < 64; ++bit) {
        if (word.bits >> bit & 1) slot.anchors.push_back(64 * word.index + bit);
      }
    }
    slot.normals = {Vec3::UnitZ()};
    for (const Vec3& d : directions_) {
      if (d.dot(point.sample.normal) > 0.3) slot.normals.push_back(d);
    }
    slots_.push_back(std::move(slot));
    cap_extra_.push_back(0);
    anchor_seeds_.push_back(runs_.seeds_at(slots_.back().anchors));
  }
}

void ClippingModel::add_top_slot() {
  Slot slot;
  slot.anchors.resize(samples_.size());
  std::iota(slot.anchors.begin(), slot.anchors.end(), 0u);
  slot.normals = {Vec3::UnitZ()};
  slots_.push_back(std::move(slot));
  cap_extra_.push_back(0);
  anchor_seeds_.push_back(runs_.seeds_at(slots_.back().anchors));
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
  auto result = std::make_shared<Cut>();
  result->slot = slot;
  result->plane = plane;
  result->taken = runs_.flood_beyond(anchor_seeds_[slot], plane, thin);
  result->count = result->taken.count();
  if (result->count == 0) return nullptr;
  BitSet foot = foot_;
  foot &= result->taken;
  if (static_cast<double>(foot.count()) >
      (1 - options_.foot_kept) * static_cast<double>(foot_list_.size())) {
    return nullptr;
  }
  return result;
}

std::shared_ptr<Cut> ClippingModel::afresh(const Cut& cut) const {
  auto again = std::make_shared<Cut>();
  again->slot = cut.slot;
  again->plane = cut.plane;
  again->taken = cut.taken;
  again->count = cut.count;
  return again;
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
  const BitSet standing = runs_.flood_faces(foot_seeds_, left);
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

}  // namespace reforge

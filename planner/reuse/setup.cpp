#include "planner/reuse/setup.h"

#include <algorithm>
#include <cmath>

#include "planner/geometry/mesh_io.h"
#include "planner/reuse/setup_paper.h"
#include "planner/reuse/setup_search.h"

namespace reforge {
namespace {

constexpr double kAboveBottom = 0.5;  // mm, where the bottom's cross-section is taken
constexpr double kOnBase = 1e-3;      // mm
constexpr double kFlat = 2e-5;        // mm; what turning may lift of a flat bottom
constexpr std::size_t kMost = 4;      // candidates
constexpr double kWorthATurn = 0.01;  // of M*

PlacedTarget placed(const LoadedPart& target, const Placement& placement, const char* setup) {
  return {rounded_to_float(placement.apply(target.in_file)), placement, setup, 0};
}

PlacedTarget by_pose(const LoadedPart& target, const Pose& pose, const char* setup) {
  Placement placement;
  placement.rotation = pose.rotation;
  placement.translation = pose.translation;
  PlacedTarget result = placed(target, placement, setup);
  for (Vec3& vertex : result.mesh.vertices) {
    if (std::abs(vertex.z()) < kFlat) vertex.z() = 0;
  }
  return result;
}

PlacedTarget by_centroids(const LoadedPart& initial, const LoadedPart& target) {
  Placement placement = target.placement;
  const Vec3 shift =
      section_centroid(initial.mesh, kAboveBottom) - section_centroid(target.mesh, kAboveBottom);
  placement.translation +=
      Vec3(std::round(shift.x() * 1024) / 1024, std::round(shift.y() * 1024) / 1024, 0);
  return placed(target, placement, "centroids");
}

bool same(const Placement& a, const Placement& b) {
  return a.turned == b.turned && (a.translation - b.translation).norm() < kOnBase;
}

bool fits(const Box3& target, const Box3& initial, const RigDescription& rig) {
  const Vec3 size = target.merged(initial).sizes();
  return size.x() <= rig.working_space_mm.x && size.y() <= rig.working_space_mm.y &&
         size.z() <= rig.working_space_mm.z;
}

// Whether a placement is possible at all; if not, a sentence is added to `why`.
bool possible(const PlacedTarget& candidate, const LoadedPart& initial, const RigDescription& rig,
              std::vector<std::string>& why) {
  const Box3 box = bounds(candidate.mesh);
  if (std::abs(box.min().z()) > kOnBase) {
    why.push_back("Setup " + candidate.setup + ": the target's bottom lies " +
                  std::to_string(std::abs(box.min().z())) + " mm " +
                  (box.min().z() < 0 ? "below" : "above") + " the initial part's.");
    return false;
  }
  if (!fits(box, bounds(initial.mesh), rig)) {
    why.push_back("Setup " + candidate.setup + ": both parts together leave the working space.");
    return false;
  }
  return true;
}

// Adds the poses found to the registered ones, and puts the most promising first.
void search(std::vector<PlacedTarget>& candidates, const LoadedPart& initial,
            const LoadedPart& target, const RigDescription& rig) {
  const PoseSampler sampler(initial.mesh, target.in_file);
  const Box3 around = bounds(initial.mesh);
  const PoseSearch found = search_poses(sampler, initial, target, kMost - candidates.size(),
                                        [&](const Box3& box) { return fits(box, around, rig); });
  double registered = 0;
  for (PlacedTarget& candidate : candidates) {
    candidate.share = common_share(initial.mesh, candidate.mesh).standing;
    registered = std::max(registered, candidate.share);
  }
  for (const Pose& pose : found.best) {
    PlacedTarget candidate = by_pose(target, pose, "search");
    candidate.share = common_share(initial.mesh, candidate.mesh).standing;
    if (candidate.share > registered + kWorthATurn) candidates.push_back(std::move(candidate));
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const PlacedTarget& a, const PlacedTarget& b) { return a.share > b.share; });
}

}  // namespace

Vec3 section_centroid(const TriangleMesh& solid, double z) {
  double twice_area = 0, x = 0, y = 0;
  for (const auto& triangle : solid.triangles) {
    // The directed segment in which the triangle crosses the height, with the inside on its left.
    Vec3 from = Vec3::Zero(), to = Vec3::Zero();
    int found = 0;
    for (int k = 0; k < 3; ++k) {
      const Vec3& a = solid.vertices[triangle[k]];
      const Vec3& b = solid.vertices[triangle[(k + 1) % 3]];
      if ((a.z() < z) == (b.z() < z)) continue;
      const Vec3 at = a + (b - a) * ((z - a.z()) / (b.z() - a.z()));
      (a.z() < z ? to : from) = at;
      ++found;
    }
    if (found != 2) continue;
    const double weight = from.x() * to.y() - from.y() * to.x();
    twice_area += weight;
    x += (from.x() + to.x()) * weight;
    y += (from.y() + to.y()) * weight;
  }
  if (std::abs(twice_area) < 1e-9) {  // nothing at this height: the middle of the part will do
    const Vec3 middle = bounds(solid).center();
    return {middle.x(), middle.y(), z};
  }
  return {x / (3 * twice_area), y / (3 * twice_area), z};
}

std::vector<PlacedTarget> place_target(const LoadedPart& initial, const LoadedPart& target,
                                       const RigDescription& rig, Setup setup,
                                       std::vector<std::string>& why) {
  std::vector<PlacedTarget> candidates;
  if (setup == Setup::kPaper) {
    const PoseSampler sampler(initial.mesh, target.in_file);
    const Box3 around = bounds(initial.mesh);
    const auto pose = paper_pose(sampler, initial, target, {},
                                 [&](const Box3& box) { return fits(box, around, rig); });
    if (pose) {
      candidates.push_back(by_pose(target, *pose, "paper"));
    } else {
      why.push_back("Setup paper: in no orientation do both parts fit the working space.");
    }
    return candidates;
  }
  if (setup != Setup::kCentroids) candidates.push_back(placed(target, initial.placement, "stored"));
  if (setup != Setup::kStored) candidates.push_back(by_centroids(initial, target));
  if (candidates.size() == 2 && same(candidates[0].placement, candidates[1].placement)) {
    candidates.pop_back();
  }
  std::erase_if(candidates, [&](const PlacedTarget& candidate) {
    return !possible(candidate, initial, rig, why);
  });
  if (setup == Setup::kSearch) search(candidates, initial, target, rig);
  return candidates;
}

}  // namespace reforge

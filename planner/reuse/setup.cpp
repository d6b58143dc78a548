#include "planner/reuse/setup.h"

#include <algorithm>
#include <cmath>

#include "planner/geometry/mesh_io.h"
#include "planner/geometry/voxel_set.h"

namespace reforge {
namespace {

constexpr double kAboveBottom = 0.5;  // mm, where the bottom's cross-section is taken
constexpr double kOnBase = 1e-3;      // mm

PlacedTarget placed(const LoadedPart& target, const Placement& placement, const char* setup) {
  return {rounded_to_float(placement.apply(target.in_file)), placement, setup};
}

PlacedTarget by_centroids(const LoadedPart& initial, const LoadedPart& target) {
  Placement placement = target.placement;
  const Vec3 shift =
      section_centroid(initial.mesh, kAboveBottom) - section_centroid(target.mesh, kAboveBottom);
  placement.translation +=
      Vec3(std::round(shift.x() * 1024) / 1024, std::round(shift.y() * 1024) / 1024, 0);
  return placed(target, placement, "centroids");
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
  const Vec3 size = box.merged(bounds(initial.mesh)).sizes();
  if (size.x() > rig.working_space_mm.x || size.y() > rig.working_space_mm.y ||
      size.z() > rig.working_space_mm.z) {
    why.push_back("Setup " + candidate.setup + ": both parts together leave the working space.");
    return false;
  }
  return true;
}

// Share of the target's volume that lies in the initial part, by sample points.
double common_share(const TriangleMesh& initial, const TriangleMesh& target) {
  const double pitch = std::clamp(std::cbrt(volume(target) / 40000), 0.25, 2.0);
  const VoxelGrid grid = VoxelGrid::over(bounds(target), pitch);
  const VoxelSet of_target = sample(target, grid), of_initial = sample(initial, grid);
  std::size_t common = 0;
  for (std::size_t cell = 0; cell < of_target.numbers.size(); ++cell) {
    common += of_target.numbers[cell] >= 0 && of_initial.numbers[cell] >= 0;
  }
  return static_cast<double>(common) /
         static_cast<double>(std::max<std::size_t>(of_target.size(), 1));
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
  if (setup != Setup::kCentroids) candidates.push_back(placed(target, initial.placement, "stored"));
  if (setup != Setup::kStored) candidates.push_back(by_centroids(initial, target));
  std::erase_if(candidates, [&](const PlacedTarget& candidate) {
    return !possible(candidate, initial, rig, why);
  });
  if (candidates.size() == 2 && common_share(initial.mesh, candidates[1].mesh) >
                                    common_share(initial.mesh, candidates[0].mesh) + 1e-3) {
    std::swap(candidates[0], candidates[1]);
  }
  return candidates;
}

}  // namespace reforge

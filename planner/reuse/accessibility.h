// Which surface points cutter and nozzle can reach, from where (paper.md, appendix B; Eq. 4 with
// its misprint mended: a point is inaccessible if from every direction something is in the way).
//
// Cutter: its ball touches the point from the side the normal points to: centre c = p + r n. On
//   borders of matter that is removed altogether the ball may as well come from within, c = p - r
//   n. No ball touches every point of a hollow corner: a sample also counts as reached if the ball
//   comes within (sqrt 2 - 1) r of it, what it leaves in a square corner: c = p + r n + r t, t
//   along the surface. The tool collides if its stack above the ball meets the obstacles; its tip
//   may not lie below z = 0.
// Nozzle: its tip is at the point; the tip may not lie below z = 0.
// Obstacles: V_R; in strict mode also pedestal and table. Tools count as upward closed
// (height_map.h). Exactness: obstacles are sampled at grid cells `pitch_mm` wide, and a tool stands
// at the centre of the
//   cell that holds it, so a tool may be misjudged by up to 0.71 pitch sideways. Bodies are
//   narrowed by that much: a body that only touches is never called blocked.
// Units: mm, part frame; directions point from the part to the spindle, unit, z >= 0.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "planner/geometry/bit_set.h"
#include "planner/geometry/height_map.h"
#include "planner/reuse/surface_samples.h"
#include "protocols/rig.h"

namespace reforge {

struct ToolBodies {
  double ball_radius_mm = 1.5;
  std::vector<ToolSection> cutter;  // from the tip; what must not touch
  std::vector<ToolSection> nozzle;
};
ToolBodies tool_bodies(const RigDescription& rig, Mode mode);

// +z, the four horizontal axes, and `count` directions spread evenly over the upper hemisphere.
std::vector<Vec3> hemisphere_directions(int count);

// Centres the ball may have when it touches a sample, exactly or as nearly as in a corner.
std::vector<Vec3> ball_centres(const SurfaceSample& sample, bool reused_goes,
                               double ball_radius_mm);

// What can be reached along one direction.
class DirectionalReach {
 public:
  // `around`: every point that will be asked for lies within 2 ball radii of one of these.
  DirectionalReach(const Vec3& direction, std::span<const TriangleMesh* const> obstacles,
                   std::span<const Vec3> around, const ToolBodies& tools, double pitch_mm);

  bool cutter_reaches(const Vec3& ball_centre) const;
  bool nozzle_reaches(const Vec3& tip) const;

 private:
  Vec3 direction_;
  double ball_radius_;
  HeightMap cutter_tips_, nozzle_tips_;
};

// For each direction, the samples that can be reached along it.
struct ReachTable {
  std::vector<BitSet> cutter, nozzle;  // by direction
  BitSet cutter_anywhere, nozzle_anywhere;
};
// Whether only the table keeps a ball cutter away from the sample.
bool is_beneath_base(const SurfaceSample& sample, double ball_radius_mm);

// For the samples in `cutter` and `nozzle` only, and only as many directions as it takes until all
// of those are served (but for those beneath the base): rows of directions that were not needed
// stay empty.
ReachTable reach_of(const std::vector<SurfaceSample>& samples, const BitSet& cutter,
                    const BitSet& nozzle, const std::vector<Vec3>& directions,
                    std::span<const TriangleMesh* const> obstacles, const ToolBodies& tools,
                    double pitch_mm);

// Whether a tool with its tip at `tip` along `direction` has `point` in its body.
bool body_holds(std::span<const ToolSection> sections, const Vec3& tip, const Vec3& direction,
                const Vec3& point);

}  // namespace reforge

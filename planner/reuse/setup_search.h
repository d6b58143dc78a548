// Looks for poses of the target that share much of it with the initial part.
//
// Free are: the side M* rests on (its stored orientation, and every stable side of its hull), yaw
// about the axis, and the position on the base. All rests and yaws are tried around both the
// centroids of the bottoms' cross-sections and the centres of gravity, roughly; the best distinct
// ones are refined in yaw and position by all samples. Poses are compared by what stands on the
// base (setup_samples.h), the stored and the centred pose apart. Units: mm, radians. Deterministic;
// about 10,000 poses whatever the parts. Limits: how well what is common can be worked is not asked
// here.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "planner/geometry/mesh_check.h"
#include "planner/reuse/setup_samples.h"

namespace reforge {

struct PoseSearch {
  std::vector<Pose> best;  // distinct, the best first
  std::size_t poses_tried = 0;
};

// `fits` tells whether a box of the target, placed, is possible at all.
PoseSearch search_poses(const PoseSampler& sampler, const LoadedPart& initial,
                        const LoadedPart& target, std::size_t wanted,
                        const std::function<bool(const Box3&)>& fits);

// The rotation about z by an angle; quarter turns are exact.
Eigen::Matrix3d yawed(double angle);

}  // namespace reforge

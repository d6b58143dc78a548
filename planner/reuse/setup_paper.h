// The published setup procedure (paper.md, section 5 and appendix D), for comparison.
//
// Coarse: 100 directions, uniform on the Gaussian sphere; each is turned upright, bottoms and
// bottom centroids aligned, and scored by Score_1 (Eq. 7). Fine: the five best rotations, each
// moved by
// {-2..2} tenths of M*'s size along x and y, are scored by Score_2 (Eq. 8). As in the published
// code both terms of both scores are normalised to 0..1 over the candidates compared. Units: mm.
// Volumes and areas are counted on samples (setup_samples.h), not by exact booleans. Notes: a
// rotation is defined up to the spin about its direction; the shortest turn is taken.
//   Positions that leave the working space are left out.
#pragma once

#include <functional>
#include <optional>

#include "planner/geometry/mesh_check.h"
#include "planner/reuse/setup_samples.h"

namespace reforge {

struct ScoreWeights {
  double volume = 0.4, shape = 0.6;  // w_1, w_2
};

std::optional<Pose> paper_pose(const PoseSampler& sampler, const LoadedPart& initial,
                               const LoadedPart& target, const ScoreWeights& weights,
                               const std::function<bool(const Box3&)>& fits);

}  // namespace reforge

// Finishing: passes a ball over the machined surface that a direction reaches, ridges no higher
// than a scallop.
//
// Purpose: raster lines where the surface is shallow (spaced by how steeply it falls across them),
// contours of equal height where it is steep; only where the surface was made by milling, so that
// untouched skin costs nothing. Units: mm, the block's frame; samples in the part frame.
// Invariants: tips lie on the tool-offset surface plus 0.005 mm; between them a path is off it by
// 0.01 mm at most; entries ramp along the path; the holder clears the stock at the block's
// finishing start. Limits: where more than the ball's radius stands above the surface (roughing did
// not get there) nothing is finished; inner edges keep the ball's fillet.
#pragma once

#include <functional>

#include "planner/toolpath/machined_surface.h"
#include "planner/toolpath/milling.h"

namespace reforge {

// Finishes the samples marked in `wanted` as far as this direction can; what was passed is marked
// in `done`.
// Paths are appended, linked to those before.
void finish(const MillingOptions& options, const Surroundings& solids,
            const std::vector<MachinedSample>& samples, const std::vector<char>& wanted,
            const std::function<bool()>& interrupted, BlockStock& stock, std::vector<char>& done,
            std::vector<Path>& paths);

// Whether a ball touching the surface at the sample, coming along the frame's tool, is clear of
// V_R, fixture and base, and its holder of `obstacles`.
bool touchable(const MachinedSample& sample, const Frame& frame, const TipFloor& floor,
               const Clearance& obstacles, double ball_radius_mm);

}  // namespace reforge

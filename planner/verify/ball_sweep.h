// The inner loop of cutting: one row of columns under a ball end that moves in a straight line.
//
// Legend: a, b the tip's ends; R the ball's radius; L the length across; m = rise / L; q along and
// e beside the path, from a; R_e = sqrt(R^2 - e^2). The lowest ball over (q, e) has its centre at
// q_c = clamp(q - R_e m / sqrt(1 + m^2), 0, L), and its surface there is
// z_a + m q_c - sqrt(R_e^2 - (q - q_c)^2): exact for level, sloped and upright moves. Floats;
// across, everything is relative to a.
#pragma once

#include "planner/geometry/mesh.h"

namespace reforge::verify {

struct BallSweep {
  BallSweep(const Vec3& a, const Vec3& b, double radius);

  float ux, uy;  // unit along the path; (1, 0) when upright
  float length;
  float slope;    // m
  float lean;     // m / sqrt(1 + m^2)
  float center;   // height of the ball's centre at a (upright: at the lower end)
  float squared;  // R^2
};

// For n columns at x = x0 + k step, all at y (relative to a): lowers surface[k] to the ball's, and
// returns the smallest difference ball - guard (at most `worst`).
float sweep_row(const BallSweep& sweep, float x0, float step, float y, int n, float* surface,
                const float* guard, float worst);

}  // namespace reforge::verify

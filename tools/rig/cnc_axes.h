// The five axes of the simulated CNC, in the order of its reports: X, Y, Z, tilt (B or A), C.
//
// Units are the controller's own: millimetres for X, Y, Z and degrees for the rotary axes, seconds,
// machine coordinates (G54 origin = g54_origin). As GRBL does, lengths and speeds of a mixed move
// are Euclidean over all five numbers; the rig never mixes them (RIG.md: rotary moves stand alone).
#pragma once

#include <array>
#include <string>

#include "protocols/rig.h"

namespace reforge {

constexpr int kAxisCount = 5;
using Axes = std::array<double, kAxisCount>;

struct CncAxes {
  std::string letters;  // "XYZBC" or "XYZAC"
  Axes min;
  Axes max;
  Axes rate;          // a second
  Axes acceleration;  // a second squared
  Axes g54_origin;
  Axes home;  // where homing ends: 1 mm off the upper ends, rotary axes at 0
};

CncAxes cnc_axes(const RigDescription& rig);

}  // namespace reforge

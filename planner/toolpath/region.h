// Regions of a plane bounded by polygons, and the operations toolpaths need on them.
//
// Purpose: offsets, unions and clips by the Clipper library, which stays in region.cpp. Units: mm,
// in the (u, v) plane of a tool frame. Invariants of every result: outer rings run
// counter-clockwise, holes clockwise, rings do not cross, no ring repeats its first point.
// Coordinates are rounded to 1e-5 mm inside.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace reforge {

using Vec2 = Eigen::Vector2d;
using Polyline = std::vector<Vec2>;  // open, or a ring whose last point is not repeated

struct PlaneRegion {
  std::vector<Polyline> rings;
  bool empty() const { return rings.empty(); }
};

double signed_area(const Polyline& ring);
double area(const PlaneRegion& region);
double length_of(const Polyline& line, bool closed);

// Rings of any orientation and crossing, by the non-zero rule.
PlaneRegion united(const std::vector<Polyline>& rings);
PlaneRegion united(const PlaneRegion& a, const PlaneRegion& b);
PlaneRegion common(const PlaneRegion& a, const PlaneRegion& b);
PlaneRegion without(const PlaneRegion& a, const PlaneRegion& b);
// Grown (by > 0) or shrunk, to within 0.02 mm: round corners are chords.
PlaneRegion offset(const PlaneRegion& region, double by);
// Open lines: the pieces inside the region, in the order of the lines.
std::vector<Polyline> inside(const std::vector<Polyline>& lines, const PlaneRegion& region);

bool contains(const PlaneRegion& region, const Vec2& point);
PlaneRegion rectangle(const Vec2& low, const Vec2& high);

// Outer rings each with its own holes.
std::vector<PlaneRegion> islands(const PlaneRegion& region);

// Fewer points, none of the dropped ones farther than `tolerance` from the line that remains.
Polyline simplified(const Polyline& line, double tolerance, bool closed);

}  // namespace reforge

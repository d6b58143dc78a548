// Where a ball-end cutter comes to rest when lowered onto solids: the tool-offset surface, exactly.
//
// Purpose: for a place (u, v) of a tool frame, the lowest centre height of a ball of radius R, with
// the cylinder of the same radius above it, that does not enter the solids. Computed against the
// triangles themselves (face, edge and corner contacts), so there is no raster error: a path that
// samples it gouges only between its samples. With R = ball + allowance it is the roughing surface.
// Units: mm, tool frame. Source: the drop-cutter method, derived anew from sphere against plane,
// line and point.
#pragma once

#include <array>
#include <limits>
#include <vector>

#include "planner/geometry/height_map.h"

namespace reforge {

constexpr double kNothingBelow = -std::numeric_limits<double>::infinity();

class OffsetSurface {
 public:
  OffsetSurface(const TriangleMesh& solid, const Frame& frame, double radius_mm);

  struct Contact {
    double centre = kNothingBelow;  // w of the ball's centre
    int triangle = -1;              // of the solid; -1 when nothing is below
    Vec3 normal = Vec3::UnitZ();    // from the contact point to the centre, tool frame
  };
  Contact contact(double u, double v) const;
  double centre(double u, double v) const { return contact(u, v).centre; }
  double radius() const { return radius_; }

 private:
  struct Facet {
    std::array<Vec3, 3> corner;  // tool frame
    Vec3 normal;
    double top;  // highest corner
    int triangle;
  };
  void rest_on(const Facet& facet, double u, double v, Contact& best) const;

  double radius_;
  std::vector<Facet> facets_;
  // Buckets over (u, v): a bucket lists every facet that a ball over it may touch, highest first.
  double cell_ = 1, u0_ = 0, v0_ = 0;
  int columns_ = 0, rows_ = 0;
  std::vector<int> bucket_start_, bucket_facets_;
};

}  // namespace reforge

// Where a ball-end cutter comes to rest when lowered onto solids: the tool-offset surface, exactly.
//
// Purpose: for a place (u, v) of a tool frame, the lowest centre height of a ball of radius R, with
// the cylinder of the same radius above it, that does not enter the solids. Computed against the
// triangles themselves (face, edge and corner contacts), so there is no raster error: a path that
// samples it gouges only between its samples. With R = ball + allowance it is the roughing surface.
// Units: mm, tool frame. Source: the drop-cutter method, derived anew from sphere against plane,
// line and point. Only faces that look up, edges that are convex and their corners can carry a
// ball; the others are left out.
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
    Vec3 normal = Vec3::UnitZ();    // from the contact point to the centre, tool frame
    bool exists() const { return centre > kNothingBelow; }
  };
  Contact contact(double u, double v) const;
  double centre(double u, double v) const { return contact(u, v).centre; }
  // Whether the ball rests higher than `height` there: cheaper than asking where.
  bool is_above(double u, double v, double height) const;
  double radius() const { return radius_; }

 private:
  struct Face {
    std::array<Vec3, 3> corner;  // tool frame
    Vec3 normal;
  };
  struct Edge {
    Vec3 from, to;
    double along_x, along_y, run, slope, secant;  // of its projection
  };
  struct Carrier {  // a face, an edge or a corner
    enum class Kind { kFace, kEdge, kCorner } kind;
    int index;
    double top;
  };
  void rest_on_face(const Face& face, double u, double v, Contact& best) const;
  void rest_on_edge(const Edge& edge, double u, double v, Contact& best) const;
  void rest_on_corner(const Vec3& corner, double u, double v, Contact& best) const;
  void rest_on(const Carrier& carrier, double u, double v, Contact& best) const;
  void collect(const TriangleMesh& solid, const Frame& frame);
  void sort_into_buckets();
  // The carriers to test at (u, v), highest first.
  std::pair<const int*, const int*> bucket(double u, double v) const;

  double radius_;
  std::vector<Face> faces_;
  std::vector<Edge> edges_;
  std::vector<Vec3> corners_;
  std::vector<Carrier> carriers_;
  // Buckets over (u, v): a bucket lists every carrier that a ball over it may touch, highest first.
  double cell_ = 1, u0_ = 0, v0_ = 0;
  int columns_ = 0, rows_ = 0;
  std::vector<int> bucket_start_, bucket_carriers_;
};

}  // namespace reforge

// A view of the part along one tool direction: a frame (u, v across, w along the tool, towards the
// spindle) and a grid of columns along w.
//
// Frame: part frame rotated, same origin. Units: mm. Column (i, j) stands at its cell's centre,
// u = u0 + (i + 1/2) pitch, v = v0 + (j + 1/2) pitch; u0 and v0 are multiples of the pitch, so that
// round coordinates fall between centres. Two views of one direction are equal.
#pragma once

#include <span>

#include "planner/geometry/mesh.h"

namespace reforge::verify {

struct View {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  // part -> view; rows are u, v, w
  double u0 = 0;
  double v0 = 0;
  double pitch = 0.1;
  int nu = 0;
  int nv = 0;

  Vec3 direction() const { return rotation.row(2); }
  Vec3 to_view(const Vec3& part) const { return rotation * part; }
  Vec3 to_part(const Vec3& view) const { return rotation.transpose() * view; }
  double u(int i) const { return u0 + (i + 0.5) * pitch; }
  double v(int j) const { return v0 + (j + 0.5) * pitch; }
  std::size_t cells() const { return static_cast<std::size_t>(nu) * static_cast<std::size_t>(nv); }
  std::size_t cell(int i, int j) const {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(nu) + static_cast<std::size_t>(i);
  }
  friend bool operator==(const View&, const View&) = default;
};

// Component noise below 1e-9 is dropped, so that an axis said in degrees is the axis.
Vec3 clean_direction(const Vec3& direction);

// The view along `direction` whose grid holds every point, and `margin` around them.
View make_view(const Vec3& direction, std::span<const Vec3> points, double margin, double pitch);

}  // namespace reforge::verify

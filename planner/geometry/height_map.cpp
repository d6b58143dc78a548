#include "planner/geometry/height_map.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>

namespace reforge {
namespace {

using Row = Eigen::Map<Eigen::ArrayXf>;
using ConstRow = Eigen::Map<const Eigen::ArrayXf>;

// out[i] = max(out[i], in[i + shift]) over the columns that both have.
void raise_shifted(float* out, const float* in, int columns, int shift, float lowered_by) {
  const int length = columns - std::abs(shift);
  if (length <= 0) return;
  Row to(out + std::max(0, -shift), length);
  const ConstRow from(in + std::max(0, shift), length);
  to = lowered_by == 0 ? to.max(from).eval() : to.max(from - lowered_by).eval();
}

HeightGrid grid_over(const Frame& frame, double pitch, double margin, const Vec3& low,
                     const Vec3& high) {
  HeightGrid grid;
  grid.frame = frame;
  grid.pitch_mm = pitch;
  const auto first = [&](double x) { return std::floor((x - margin) / pitch); };
  const auto last = [&](double x) { return std::floor((x + margin) / pitch); };
  grid.u0 = (first(low.x()) + 0.5) * pitch;
  grid.v0 = (first(low.y()) + 0.5) * pitch;
  grid.columns = static_cast<int>(last(high.x()) - first(low.x())) + 1;
  grid.rows = static_cast<int>(last(high.y()) - first(low.y())) + 1;
  return grid;
}

// A triangle in cell coordinates: x column, y row (centres at integers), z height.
struct CellTriangle {
  Vec3 corner[3];
  double slope_x, slope_y, top;
};

// The range of x that the triangle covers within the rows y_low..y_high (equal: on that line).
bool range_in_band(const CellTriangle& triangle, double y_low, double y_high, double& x_low,
                   double& x_high) {
  x_low = std::numeric_limits<double>::infinity();
  x_high = -x_low;
  const auto take = [&](double x) {
    x_low = std::min(x_low, x);
    x_high = std::max(x_high, x);
  };
  for (int k = 0; k < 3; ++k) {
    const Vec3& a = triangle.corner[k];
    const Vec3& b = triangle.corner[(k + 1) % 3];
    if (a.y() >= y_low && a.y() <= y_high) take(a.x());
    for (const double y : {y_low, y_high}) {
      if ((a.y() < y) != (b.y() < y)) take(a.x() + (b.x() - a.x()) * (y - a.y()) / (b.y() - a.y()));
    }
  }
  return x_low <= x_high;
}

void rasterise(HeightMap& map, const CellTriangle& t, Sampling sampling) {
  constexpr double kOnEdge = 1e-9;  // cells: a centre on an edge belongs to both neighbours
  const double half = sampling == Sampling::kConservative ? 0.5 : 0;
  const auto [y_min, y_max] = std::minmax({t.corner[0].y(), t.corner[1].y(), t.corner[2].y()});
  const int row_from = std::max(0, static_cast<int>(std::ceil(y_min - half - kOnEdge)));
  const int row_to =
      std::min(map.grid.rows - 1, static_cast<int>(std::floor(y_max + half + kOnEdge)));
  const double rise = half * (std::abs(t.slope_x) + std::abs(t.slope_y));
  for (int row = row_from; row <= row_to; ++row) {
    double x_low, x_high;
    const double y_low = std::clamp(row - half, y_min, y_max);
    const double y_high = std::clamp(row + half, y_min, y_max);
    if (!range_in_band(t, y_low, y_high, x_low, x_high)) continue;
    const int from = std::max(0, static_cast<int>(std::ceil(x_low - half - kOnEdge)));
    const int to =
        std::min(map.grid.columns - 1, static_cast<int>(std::floor(x_high + half + kOnEdge)));
    const double at_column_0 =
        t.corner[0].z() + t.slope_y * (row - t.corner[0].y()) - t.slope_x * t.corner[0].x() + rise;
    for (int column = from; column <= to; ++column) {
      const auto height = static_cast<float>(std::min(t.top, at_column_0 + t.slope_x * column));
      float& cell = map.at(column, row);
      if (height > cell) cell = height;
    }
  }
}

}  // namespace

Frame Frame::along(const Vec3& unit_direction) {
  assert(std::abs(unit_direction.norm() - 1) < 1e-6);
  Frame frame;
  frame.d = unit_direction.normalized();
  const Vec3 sideways = Vec3::UnitZ().cross(frame.d);
  if (sideways.norm() < 1e-9) {
    frame.u = Vec3::UnitX();
  } else {
    frame.u = sideways.normalized();
  }
  frame.v = frame.d.cross(frame.u);
  return frame;
}

HeightGrid HeightGrid::over(const Frame& frame, double pitch_mm, const Box3& box,
                            double margin_mm) {
  std::vector<Vec3> corners;
  for (int k = 0; k < 8 && !box.isEmpty(); ++k) {
    corners.push_back(box.corner(static_cast<Box3::CornerType>(k)));
  }
  return over(frame, pitch_mm, corners, margin_mm);
}

HeightGrid HeightGrid::over(const Frame& frame, double pitch_mm, std::span<const Vec3> points,
                            double margin_mm) {
  Box3 box;
  for (const Vec3& point : points) box.extend(frame.to_local(point));
  if (box.isEmpty()) {
    HeightGrid none;
    none.frame = frame;
    none.pitch_mm = pitch_mm;
    return none;
  }
  return grid_over(frame, pitch_mm, margin_mm, box.min(), box.max());
}

Vec3 HeightGrid::centre(int column, int row, double height) const {
  return frame.to_part({u0 + column * pitch_mm, v0 + row * pitch_mm, height});
}

float HeightMap::lookup(const Vec3& part_point) const {
  const double column = (grid.frame.u.dot(part_point) - grid.u0) / grid.pitch_mm + 0.5;
  const double row = (grid.frame.v.dot(part_point) - grid.v0) / grid.pitch_mm + 0.5;
  if (!(column >= 0 && row >= 0 && column < grid.columns && row < grid.rows)) return kEmpty;
  return at(static_cast<int>(column), static_cast<int>(row));
}

void raise_to(HeightMap& map, const TriangleMesh& solid, Sampling sampling) {
  const HeightGrid& grid = map.grid;
  if (grid.columns == 0 || grid.rows == 0) return;
  std::vector<Vec3> cells;
  cells.reserve(solid.vertices.size());
  for (const Vec3& vertex : solid.vertices) {
    const Vec3 local = grid.frame.to_local(vertex);
    cells.emplace_back((local.x() - grid.u0) / grid.pitch_mm, (local.y() - grid.v0) / grid.pitch_mm,
                       local.z());
  }
  for (const auto& [a, b, c] : solid.triangles) {
    CellTriangle t{{cells[a], cells[b], cells[c]}, 0, 0, 0};
    const Vec3 normal = (t.corner[1] - t.corner[0]).cross(t.corner[2] - t.corner[0]);
    // The envelope of a solid is made of faces that look up; walls are bounded by them.
    if (!(normal.z() > 1e-12)) continue;
    t.slope_x = -normal.x() / normal.z();
    t.slope_y = -normal.y() / normal.z();
    t.top = std::max({t.corner[0].z(), t.corner[1].z(), t.corner[2].z()});
    rasterise(map, t, sampling);
  }
}

HeightMap upper_envelope(const HeightGrid& grid, const TriangleMesh& solid, Sampling sampling) {
  HeightMap map(grid);
  raise_to(map, solid, sampling);
  return map;
}

HeightMap dilated(const HeightMap& map, double radius_mm) {
  const int columns = map.grid.columns, rows = map.grid.rows;
  const double radius = radius_mm / map.grid.pitch_mm;
  const double square = radius * radius - 1e-9;
  HeightMap result(map.grid);
  if (square <= 0) return result;
  const int reach = std::min(static_cast<int>(radius), std::max(columns, rows));
  // Half width of the disc in each row away from its centre, grouped by width, narrow first.
  std::map<int, std::vector<int>> rows_of_width;
  for (int dy = -reach; dy <= reach; ++dy) {
    const double left = square - static_cast<double>(dy) * dy;
    if (left >= 0) rows_of_width[static_cast<int>(std::sqrt(left))].push_back(dy);
  }
  // `wide`: the map with every cell raised to the highest of its row within `width` cells.
  std::vector<float> wide = map.heights, wider;
  int width = 0;
  for (const auto& [wanted, offsets] : rows_of_width) {
    while (width < wanted) {
      // Two windows of half width w, moved apart by s <= w (1 for w = 0), cover half width w + s
      // together with the one in the middle.
      const int step = std::min(wanted - width, std::max(width, 1));
      wider = wide;
      for (int row = 0; row < rows; ++row) {
        const auto start = static_cast<std::size_t>(row) * columns;
        raise_shifted(&wider[start], &wide[start], columns, -step, 0);
        raise_shifted(&wider[start], &wide[start], columns, step, 0);
      }
      wide.swap(wider);
      width += step;
    }
    for (const int dy : offsets) {
      for (int row = std::max(0, -dy); row < std::min(rows, rows - dy); ++row) {
        raise_shifted(&result.heights[static_cast<std::size_t>(row) * columns],
                      &wide[static_cast<std::size_t>(row + dy) * columns], columns, 0, 0);
      }
    }
  }
  return result;
}

HeightMap tip_heights(const HeightMap& map, double radius_mm,
                      const std::function<double(double)>& underside) {
  const int columns = map.grid.columns, rows = map.grid.rows;
  const double radius = radius_mm / map.grid.pitch_mm;
  const int reach = std::min(static_cast<int>(radius), std::max(columns, rows));
  HeightMap result(map.grid);
  for (int dy = -reach; dy <= reach; ++dy) {
    for (int dx = -reach; dx <= reach; ++dx) {
      const double distance = std::hypot(dx, dy);
      if (!(distance * distance < radius * radius - 1e-9)) continue;
      const double under = underside(distance * map.grid.pitch_mm);
      if (!std::isfinite(under)) continue;
      for (int row = std::max(0, -dy); row < std::min(rows, rows - dy); ++row) {
        raise_shifted(&result.heights[static_cast<std::size_t>(row) * columns],
                      &map.heights[static_cast<std::size_t>(row + dy) * columns], columns, dx,
                      static_cast<float>(under));
      }
    }
  }
  return result;
}

HeightMap tip_heights_of_ball(const HeightMap& map, double radius_mm) {
  return tip_heights(map, radius_mm, [radius_mm](double distance) {
    return radius_mm - std::sqrt(std::max(0.0, radius_mm * radius_mm - distance * distance));
  });
}

HeightMap tip_heights(const HeightMap& map, std::span<const ToolSection> sections,
                      double widen_mm) {
  HeightMap result(map.grid);
  double widest = 0;
  const auto lower = [](HeightMap& heights, double by) {
    for (float& height : heights.heights) height -= static_cast<float>(by);
  };
  for (const ToolSection& section : sections) {
    if (section.r_from_mm > widest) {
      widest = section.r_from_mm;
      if (std::isinf(widest)) {
        const auto highest = std::max_element(map.heights.begin(), map.heights.end());
        if (highest == map.heights.end()) return result;
        const auto limit = *highest - static_cast<float>(section.z_from_mm);
        for (float& height : result.heights) height = std::max(height, limit);
        return result;
      }
      HeightMap disc = dilated(map, widest + widen_mm);
      lower(disc, section.z_from_mm);
      raise_to(result, disc);
    }
    if (section.r_to_mm > widest) {
      const double slope =
          (section.z_to_mm - section.z_from_mm) / (section.r_to_mm - section.r_from_mm);
      const double inner = widest;
      raise_to(result, tip_heights(map, section.r_to_mm + widen_mm, [&](double distance) {
                 const double r = std::max(distance - widen_mm, inner);
                 return section.z_from_mm + slope * (r - section.r_from_mm);
               }));
      widest = section.r_to_mm;
    }
  }
  return result;
}

void raise_to(HeightMap& map, const HeightMap& other) {
  assert(map.heights.size() == other.heights.size());
  for (std::size_t i = 0; i < map.heights.size(); ++i) {
    if (other.heights[i] > map.heights[i]) map.heights[i] = other.heights[i];
  }
}

}  // namespace reforge

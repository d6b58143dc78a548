#include "planner/geometry/voxel_set.h"

#include <algorithm>
#include <cmath>

namespace reforge {
namespace {

struct Crossing {
  double z;
  int turn;  // +1 entering going up, -1 leaving
};

// Which side of the directed edge a -> b the point lies on, the same number with opposite sign for
// b -> a: the corners are always taken in the same order.
double side_of(const Vec3& a, const Vec3& b, double x, double y) {
  const bool swapped = b.x() < a.x() || (b.x() == a.x() && b.y() < a.y());
  const Vec3& p = swapped ? b : a;
  const Vec3& q = swapped ? a : b;
  const double side = (q.x() - p.x()) * (y - p.y()) - (q.y() - p.y()) * (x - p.x());
  return swapped ? -side : side;
}

// A point exactly on an edge counts for the edge's forward direction only.
bool inside_of(const Vec3& a, const Vec3& b, double x, double y) {
  const double side = side_of(a, b, x, y);
  return side > 0 || (side == 0 && (a.y() < b.y() || (a.y() == b.y() && a.x() < b.x())));
}

std::vector<std::vector<Crossing>> crossings(const TriangleMesh& solid, const VoxelGrid& grid) {
  std::vector<std::vector<Crossing>> columns(static_cast<std::size_t>(grid.size[0]) * grid.size[1]);
  const auto cell_from = [&](double x, int axis) {
    return std::max(0, static_cast<int>(std::ceil((x - grid.origin[axis]) / grid.pitch_mm - 1e-6)));
  };
  const auto cell_to = [&](double x, int axis) {
    return std::min(grid.size[axis] - 1,
                    static_cast<int>(std::floor((x - grid.origin[axis]) / grid.pitch_mm + 1e-6)));
  };
  for (const auto& triangle : solid.triangles) {
    Vec3 a = solid.vertices[triangle[0]], b = solid.vertices[triangle[1]],
         c = solid.vertices[triangle[2]];
    const double twice_area = (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
    if (twice_area == 0) continue;
    const int turn = twice_area > 0 ? -1 : 1;  // looks up: leaving
    if (turn > 0) std::swap(b, c);
    const Vec3 normal = (b - a).cross(c - a);
    const auto [x_min, x_max] = std::minmax({a.x(), b.x(), c.x()});
    const auto [y_min, y_max] = std::minmax({a.y(), b.y(), c.y()});
    for (int j = cell_from(y_min, 1); j <= cell_to(y_max, 1); ++j) {
      for (int i = cell_from(x_min, 0); i <= cell_to(x_max, 0); ++i) {
        const double x = grid.origin.x() + grid.pitch_mm * i;
        const double y = grid.origin.y() + grid.pitch_mm * j;
        if (!inside_of(a, b, x, y) || !inside_of(b, c, x, y) || !inside_of(c, a, x, y)) continue;
        const double z = a.z() - (normal.x() * (x - a.x()) + normal.y() * (y - a.y())) / normal.z();
        columns[static_cast<std::size_t>(j) * grid.size[0] + i].push_back({z, turn});
      }
    }
  }
  return columns;
}

// The 26 steps to a neighbour, those through a face first.
std::vector<std::array<int, 3>> neighbour_steps() {
  std::vector<std::array<int, 3>> steps;
  for (const bool through_face : {true, false}) {
    for (int n = 0; n < 27; ++n) {
      const std::array<int, 3> step{n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1};
      const int moved = std::abs(step[0]) + std::abs(step[1]) + std::abs(step[2]);
      if (moved > 0 && (moved == 1) == through_face) steps.push_back(step);
    }
  }
  return steps;
}

void link_neighbours(VoxelSet& set) {
  const auto steps = neighbour_steps();
  set.neighbours.resize(set.size());
  for (std::size_t v = 0; v < set.size(); ++v) {
    const auto [i, j, k] = set.voxels[v];
    for (std::size_t n = 0; n < steps.size(); ++n) {
      set.neighbours[v][n] = set.number(i + steps[n][0], j + steps[n][1], k + steps[n][2]);
    }
  }
}

}  // namespace

VoxelGrid VoxelGrid::over(const Box3& box, double pitch_mm) {
  VoxelGrid grid;
  grid.pitch_mm = pitch_mm;
  if (box.isEmpty()) return grid;
  for (int axis = 0; axis < 3; ++axis) {
    const double extent = box.max()[axis] - box.min()[axis];
    grid.size[axis] = std::max(1, static_cast<int>(std::ceil(extent / pitch_mm)));
  }
  // Centred in x and y; from the bottom up in z, so that layers keep their distance from the base.
  const Vec3 spare = Vec3(grid.size[0], grid.size[1], grid.size[2]) * pitch_mm - box.sizes();
  grid.origin = box.min() + Vec3::Constant(pitch_mm / 2) - Vec3(spare.x() / 2, spare.y() / 2, 0);
  return grid;
}

std::int32_t VoxelSet::number(int i, int j, int k) const {
  if (i < 0 || j < 0 || k < 0 || i >= grid.size[0] || j >= grid.size[1] || k >= grid.size[2]) {
    return -1;
  }
  return numbers[(static_cast<std::size_t>(k) * grid.size[1] + j) * grid.size[0] + i];
}

std::int32_t VoxelSet::number_at(const Vec3& at) const {
  const Vec3 cell = (at - grid.origin) / grid.pitch_mm + Vec3::Constant(0.5);
  return number(static_cast<int>(std::floor(cell.x())), static_cast<int>(std::floor(cell.y())),
                static_cast<int>(std::floor(cell.z())));
}

std::vector<std::uint8_t> occupancy(const TriangleMesh& solid, const VoxelGrid& grid) {
  std::vector<std::uint8_t> is_inside(grid.cells(), 0);
  auto columns = crossings(solid, grid);
  for (int j = 0; j < grid.size[1]; ++j) {
    for (int i = 0; i < grid.size[0]; ++i) {
      auto& column = columns[static_cast<std::size_t>(j) * grid.size[0] + i];
      std::sort(column.begin(), column.end(), [](const Crossing& a, const Crossing& b) {
        return a.z < b.z || (a.z == b.z && a.turn > b.turn);
      });
      std::size_t next = 0;
      int winding = 0;
      for (int k = 0; k < grid.size[2]; ++k) {
        const double z = grid.origin.z() + grid.pitch_mm * k;
        while (next < column.size() && column[next].z <= z) winding += column[next++].turn;
        if (winding > 0) {
          is_inside[(static_cast<std::size_t>(k) * grid.size[1] + j) * grid.size[0] + i] = 1;
        }
      }
    }
  }
  return is_inside;
}

VoxelSet sample(const TriangleMesh& solid, const VoxelGrid& grid) {
  VoxelSet set;
  set.grid = grid;
  set.numbers.assign(grid.cells(), -1);
  const auto is_inside = occupancy(solid, grid);
  std::int32_t count = 0;
  std::size_t cell = 0;
  for (int k = 0; k < grid.size[2]; ++k) {
    for (int j = 0; j < grid.size[1]; ++j) {
      for (int i = 0; i < grid.size[0]; ++i, ++cell) {
        if (!is_inside[cell]) continue;
        set.numbers[cell] = count++;
        set.voxels.push_back({i, j, k});
        set.points.push_back(grid.centre(i, j, k));
      }
    }
  }
  link_neighbours(set);
  return set;
}

BitSet flood(const VoxelSet& set, const std::vector<std::uint32_t>& seeds, const BitSet& allowed,
             Connectivity connectivity) {
  BitSet reached(set.size());
  std::vector<std::uint32_t> front;
  const auto visit = [&](std::uint32_t number) {
    if (!allowed.test(number) || reached.test(number)) return;
    reached.set(number);
    front.push_back(number);
  };
  for (const auto seed : seeds) visit(seed);
  while (!front.empty()) {
    const auto number = front.back();
    front.pop_back();
    const auto count = static_cast<std::size_t>(connectivity);
    for (std::size_t n = 0; n < count; ++n) {
      const auto next = set.neighbours[number][n];
      if (next >= 0) visit(static_cast<std::uint32_t>(next));
    }
  }
  return reached;
}

std::vector<BitSet> components(const VoxelSet& set, const BitSet& subset,
                               Connectivity connectivity) {
  std::vector<BitSet> found;
  BitSet left = subset;
  for (std::uint32_t number = 0; number < set.size(); ++number) {
    if (!left.test(number)) continue;
    found.push_back(flood(set, {number}, left, connectivity));
    left.subtract(found.back());
  }
  return found;
}

}  // namespace reforge

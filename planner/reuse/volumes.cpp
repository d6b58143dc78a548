#include "planner/reuse/volumes.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "planner/geometry/mesh_topology.h"
#include "planner/reuse/tolerant_overlay.h"

namespace reforge {
namespace {

constexpr double kSkin = 2e-3;         // mm
constexpr double kOnBase = 1e-3;       // mm above z = 0
constexpr double kFootHeight = 0.5;    // mm, where a foot that is not flat is measured
constexpr double kSmallestFoot = 0.1;  // mm^2

// A connected shell of one region's boundary.
struct Shell {
  TriangleMesh surface;               // outward
  std::vector<std::uint32_t> facets;  // of the complex
};

std::vector<Shell> shells_of(const CellComplex& complex, Region region) {
  std::vector<std::uint32_t> facets;
  const TriangleMesh surface = surface_of(complex, in(region), &facets);
  std::uint32_t count = 0;
  const auto piece = pieces(surface, count);
  std::vector<Shell> shells(count);
  for (auto& shell : shells) shell.surface.vertices = surface.vertices;
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    shells[piece[t]].surface.triangles.push_back(surface.triangles[t]);
    shells[piece[t]].facets.push_back(facets[t]);
  }
  for (auto& shell : shells) shell.surface = welded(shell.surface);
  return shells;
}

void relabel(CellComplex& complex, const std::vector<std::uint32_t>& facets, Region from,
             Region to) {
  for (const auto f : facets) {
    CellFacet& facet = complex.facets[f];
    if (facet.front == from) facet.front = to;
    if (facet.back == from) facet.back = to;
  }
}

// The region with the most area on the other side of a shell.
Region main_neighbour(const CellComplex& complex, const Shell& shell, Region self) {
  std::array<double, 32> shared{};
  for (const auto f : shell.facets) {
    const auto& [corners, front, back, origin, mark] = complex.facets[f];
    const auto& v = complex.vertices;
    const double twice_area =
        (v[corners[1]] - v[corners[0]]).cross(v[corners[2]] - v[corners[0]]).norm();
    shared[front == self ? back : front] += twice_area;
  }
  return static_cast<Region>(std::max_element(shared.begin(), shared.end()) - shared.begin());
}

void drop_slivers(CellComplex& complex, Region region, double thinner_than_mm) {
  for (const Shell& shell : shells_of(complex, region)) {
    const double shell_volume = volume(shell.surface);
    if (shell_volume < 0 || 2 * shell_volume > thinner_than_mm * area(shell.surface)) continue;
    relabel(complex, shell.facets, region, main_neighbour(complex, shell, region));
  }
  tidy(complex);
}

// Area of a surface's triangles that lie on the base.
double flat_foot(const TriangleMesh& surface) {
  double standing = 0;
  for (const auto& [a, b, c] : surface.triangles) {
    const auto& v = surface.vertices;
    if (std::max({v[a].z(), v[b].z(), v[c].z()}) > kOnBase) continue;
    standing += (v[b] - v[a]).cross(v[c] - v[a]).norm() / 2;
  }
  return standing;
}

// Area of the cross-section a little above the base.
double section_area(const TriangleMesh& surface) {
  double twice_area = 0;
  for (const auto& triangle : surface.triangles) {
    Vec3 from = Vec3::Zero(), to = Vec3::Zero();  // inside on the left
    bool crosses_it = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3& a = surface.vertices[triangle[k]];
      const Vec3& b = surface.vertices[triangle[(k + 1) % 3]];
      if ((a.z() < kFootHeight) == (b.z() < kFootHeight)) continue;
      const Vec3 at = a + (b - a) * ((kFootHeight - a.z()) / (b.z() - a.z()));
      (a.z() < kFootHeight ? to : from) = at;
      crosses_it = true;
    }
    if (crosses_it) twice_area += from.x() * to.y() - from.y() * to.x();
  }
  return twice_area / 2;
}

// Whether a piece reaches the base and has a foot there, flat or rounded.
bool stands(const TriangleMesh& surface) {
  if (bounds(surface).min().z() > kOnBase) return false;
  return flat_foot(surface) >= kSmallestFoot || section_area(surface) >= kSmallestFoot;
}

// A facet with its box, for asking what lies just beyond another facet.
struct Wall {
  std::array<Vec3, 3> corner;
  Box3 box;
  std::uint8_t front, back;
};

std::vector<Wall> walls_of(const CellComplex& complex) {
  std::vector<Wall> walls;
  for (const CellFacet& facet : complex.facets) {
    Wall wall{{}, {}, facet.front, facet.back};
    for (int k = 0; k < 3; ++k) {
      wall.corner[k] = complex.vertices[facet.corners[k]];
      wall.box.extend(wall.corner[k]);
    }
    walls.push_back(wall);
  }
  return walls;
}

// Whether the segment from `from` to `to` passes through the triangle (Moeller, Trumbore).
bool crosses(const Vec3& from, const Vec3& to, const Wall& wall) {
  const Vec3 along = to - from, a = wall.corner[1] - wall.corner[0],
             b = wall.corner[2] - wall.corner[0];
  const Vec3 p = along.cross(b);
  const double determinant = a.dot(p);
  if (std::abs(determinant) < 1e-300) return false;
  const Vec3 s = from - wall.corner[0];
  const double u = s.dot(p) / determinant;
  const Vec3 q = s.cross(a);
  const double v = along.dot(q) / determinant, t = b.dot(q) / determinant;
  return u >= -1e-9 && v >= -1e-9 && u + v <= 1 + 1e-9 && t >= 0 && t <= 1;
}

// Walls by the cells of a coarse grid that their boxes touch.
class WallGrid {
 public:
  explicit WallGrid(const std::vector<Wall>& walls) {
    for (const Wall& wall : walls) all_.extend(wall.box);
    cells_.resize(kCells * kCells * kCells);
    for (std::uint32_t w = 0; w < walls.size(); ++w) {
      const auto low = cell_of(walls[w].box.min()), high = cell_of(walls[w].box.max());
      for (int k = low[2]; k <= high[2]; ++k) {
        for (int j = low[1]; j <= high[1]; ++j) {
          for (int i = low[0]; i <= high[0]; ++i) cells_[index(i, j, k)].push_back(w);
        }
      }
    }
  }
  // Whether `asked` is true of any wall in the cells that the box touches.
  template <typename Asked>
  bool any(const Box3& box, Asked asked) const {
    const auto low = cell_of(box.min()), high = cell_of(box.max());
    for (int k = low[2]; k <= high[2]; ++k) {
      for (int j = low[1]; j <= high[1]; ++j) {
        for (int i = low[0]; i <= high[0]; ++i) {
          const auto& cell = cells_[index(i, j, k)];
          if (std::any_of(cell.begin(), cell.end(), asked)) return true;
        }
      }
    }
    return false;
  }

 private:
  static constexpr int kCells = 32;  // along each axis
  static std::size_t index(int i, int j, int k) {
    return (static_cast<std::size_t>(k) * kCells + static_cast<std::size_t>(j)) * kCells +
           static_cast<std::size_t>(i);
  }
  std::array<int, 3> cell_of(const Vec3& point) const {
    std::array<int, 3> cell{};
    for (int axis = 0; axis < 3; ++axis) {
      const double size = std::max(1e-9, all_.sizes()[axis]);
      const double at = (point[axis] - all_.min()[axis]) / size * kCells;
      cell[axis] = static_cast<int>(std::clamp(at, 0.0, kCells - 1.0));
    }
    return cell;
  }
  Box3 all_;
  std::vector<std::vector<std::uint32_t>> cells_;
};

// Facets behind which V~_S or V~_A is only a skin: within kSkin of the middle, it ends.
std::vector<bool> find_skins(const CellComplex& complex) {
  const auto walls = walls_of(complex);
  const WallGrid grid(walls);
  std::vector<bool> is_skin(walls.size(), false);
  for (std::uint32_t f = 0; f < walls.size(); ++f) {
    const Wall& own = walls[f];
    const Vec3 cross = (own.corner[1] - own.corner[0]).cross(own.corner[2] - own.corner[0]);
    if (!(cross.norm() > 1e-12)) {
      is_skin[f] = true;
      continue;
    }
    const Vec3 normal = cross.normalized();
    const Vec3 middle = (own.corner[0] + own.corner[1] + own.corner[2]) / 3;
    for (const int side : {1, -1}) {
      const auto region = side > 0 ? own.front : own.back;
      if (region != kRemoved && region != kAdded) continue;
      const Vec3 beyond = middle + side * kSkin * normal;
      const Box3 reach = Box3(middle.cwiseMin(beyond), middle.cwiseMax(beyond));
      is_skin[f] = is_skin[f] || grid.any(reach, [&](std::uint32_t w) {
        const Wall& wall = walls[w];
        return w != f && (wall.front == region || wall.back == region) &&
               wall.box.intersects(reach) && crosses(middle, beyond, wall);
      });
    }
  }
  return is_skin;
}

bool identical(const TriangleMesh& a, const TriangleMesh& b) {
  return a.triangles == b.triangles && a.vertices == b.vertices;
}

}  // namespace

Result<Volumes> ideal_volumes(const TriangleMesh& initial, const TriangleMesh& target,
                              double tolerance_mm) {
  Volumes volumes;
  if (identical(initial, target)) {
    volumes.complex.vertices = initial.vertices;
    for (std::uint32_t t = 0; t < initial.triangles.size(); ++t) {
      volumes.complex.facets.push_back({initial.triangles[t], kOutside, kReused, t, 0});
    }
    tidy(volumes.complex);
    volumes.is_skin.assign(volumes.complex.facets.size(), false);
    volumes.coincident_area_mm2 = area(initial);
    return volumes;
  }
  auto both = tolerant_overlay(initial, target, tolerance_mm);
  if (!both) return both.error();
  volumes.complex = std::move(both->complex);
  volumes.coincident_area_mm2 = both->coincident_area_mm2;
  constexpr std::array<std::uint8_t, 4> kRegionOf{kOutside, kRemoved, kAdded, kReused};
  for (CellFacet& facet : volumes.complex.facets) {
    facet.front = kRegionOf[facet.front];
    facet.back = kRegionOf[facet.back];
  }
  for (const Region region : {kRemoved, kAdded, kReused}) {
    drop_slivers(volumes.complex, region, tolerance_mm);
  }
  const double reused = volume_of(volumes.complex, kReused);
  volumes.dropped_mm3 = volume(target) - reused - volume_of(volumes.complex, kAdded);
  volumes.dropped_initial_mm3 = volume(initial) - reused - volume_of(volumes.complex, kRemoved);
  auto& facets = volumes.complex.facets;
  for (std::uint32_t f = 0; f < facets.size(); ++f) facets[f].origin = f;
  volumes.is_skin = find_skins(volumes.complex);
  return volumes;
}

double set_loose_pieces_free(CellComplex& complex) {
  const auto shells = shells_of(complex, kReused);
  std::vector<bool> loose(shells.size(), false);
  double freed = 0;
  for (std::size_t i = 0; i < shells.size(); ++i) {
    loose[i] = volume(shells[i].surface) > 0 && !stands(shells[i].surface);
  }
  for (std::size_t i = 0; i < shells.size(); ++i) {
    const double shell_volume = volume(shells[i].surface);
    bool goes = loose[i];
    if (shell_volume <= 0) {  // a hollow goes with the piece around it
      for (std::size_t j = 0; j < shells.size() && !goes; ++j) {
        goes = loose[j] && contains(shells[j].surface, shells[i].surface.vertices.front());
      }
    }
    if (!goes) continue;
    freed += shell_volume;
    relabel(complex, shells[i].facets, kReused, kThenAdded);
  }
  tidy(complex);
  return freed;
}

}  // namespace reforge

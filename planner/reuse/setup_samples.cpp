#include "planner/reuse/setup_samples.h"

#include <algorithm>
#include <cmath>

namespace reforge {
namespace {

constexpr double kCells = 2e6;            // of an occupancy grid, about
constexpr double kSamples = 12000;        // of M*
constexpr double kFineSamples = 200000;   // of M*, for the last word
constexpr double kSurfaceSamples = 4000;  // of M
constexpr double kFinest = 0.1;           // mm

// Points at even steps of area along the list of triangles, spread within each by the golden ratio.
std::vector<Vec3> surface_points(const TriangleMesh& mesh, double step_mm2) {
  constexpr double kGolden = 0.6180339887498949, kSilver = 0.4142135623730951;
  std::vector<Vec3> points;
  double left = step_mm2 / 2;
  for (const auto& [i, j, k] : mesh.triangles) {
    const Vec3 &a = mesh.vertices[i], &b = mesh.vertices[j], &c = mesh.vertices[k];
    for (left -= (b - a).cross(c - a).norm() / 2; left < 0; left += step_mm2) {
      const double n = static_cast<double>(points.size());
      double u = std::fmod(kGolden * n, 1), v = std::fmod(kSilver * n, 1);
      if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
      }
      points.push_back(a + u * (b - a) + v * (c - a));
    }
  }
  return points;
}

// The n-th of points spread evenly over a unit cube about the origin (Roberts' R3 sequence).
Vec3 spread(std::size_t n) {
  const double x = static_cast<double>(n);
  return Vec3(std::fmod(0.8191725133961645 * x, 1), std::fmod(0.6710436067037893 * x, 1),
              std::fmod(0.5497004779019703 * x, 1)) -
         Vec3::Constant(0.5);
}

// The cells of `common` that hang together, through faces, with the lowest two layers.
std::size_t count_standing(std::vector<std::uint8_t> common, const VoxelGrid& grid) {
  const std::size_t row = static_cast<std::size_t>(grid.size[0]),
                    layer = row * static_cast<std::size_t>(grid.size[1]);
  std::vector<std::size_t> front;
  std::size_t count = 0;
  const auto visit = [&](std::size_t cell) {
    if (!common[cell]) return;
    common[cell] = 0;
    front.push_back(cell);
    ++count;
  };
  for (std::size_t cell = 0; cell < std::min(common.size(), 2 * layer); ++cell) visit(cell);
  while (!front.empty()) {
    const std::size_t cell = front.back();
    front.pop_back();
    const std::size_t i = cell % row, j = cell % layer / row, k = cell / layer;
    if (i > 0) visit(cell - 1);
    if (i + 1 < row) visit(cell + 1);
    if (j > 0) visit(cell - row);
    if (j + 1 < layer / row) visit(cell + row);
    if (k > 0) visit(cell - layer);
    if (cell + layer < common.size()) visit(cell + layer);
  }
  return count;
}

}  // namespace

CommonShare common_share(const TriangleMesh& initial, const TriangleMesh& target) {
  const Box3 box = bounds(target);
  VoxelGrid grid =
      VoxelGrid::over(box, std::max(kFinest, std::cbrt(volume(target) / kFineSamples)));
  // Off the middle, so that no layer of centres lies in a wall of a part with even measures.
  grid.origin += grid.pitch_mm * Vec3(0.118, -0.073, 0.031);
  auto common = occupancy(target, grid);
  const auto of_initial = occupancy(initial, grid);
  std::size_t all = 0, both = 0;
  for (std::size_t cell = 0; cell < common.size(); ++cell) {
    all += common[cell];
    common[cell] = common[cell] && of_initial[cell];
    both += common[cell];
  }
  if (all == 0) return {};
  const auto share = [all](std::size_t count) {
    return static_cast<double>(count) / static_cast<double>(all);
  };
  return {share(both), share(count_standing(std::move(common), grid))};
}

PoseSampler::Cells PoseSampler::cells_of(const TriangleMesh& solid) {
  const Box3 box = bounds(solid);
  Cells cells;
  cells.grid = VoxelGrid::over(box, std::max(kFinest, std::cbrt(box.volume() / kCells)));
  cells.is_inside = occupancy(solid, cells.grid);
  return cells;
}

PoseSampler::PoseSampler(const TriangleMesh& initial, const TriangleMesh& target_in_file)
    : initial_(cells_of(initial)),
      target_(cells_of(target_in_file)),
      surface_mm2_(area(initial) / kSurfaceSamples) {
  const VoxelGrid grid = VoxelGrid::over(
      bounds(target_in_file), std::max(kFinest, std::cbrt(volume(target_in_file) / kSamples)));
  // One point in each voxel, anywhere in it: centres would fall in step with ribs along an axis,
  // and none would lie near the surface.
  std::size_t n = 0;
  for (int k = 0; k < grid.size[2]; ++k) {
    for (int j = 0; j < grid.size[1]; ++j) {
      for (int i = 0; i < grid.size[0]; ++i, ++n) {
        const Vec3 point = grid.centre(i, j, k) + grid.pitch_mm * spread(n);
        if (!target_.at((point - target_.grid.origin) / target_.grid.pitch_mm +
                        Vec3::Constant(0.5))) {
          continue;
        }
        fine_.push_back(point);
        if (i % 2 == 0 && j % 2 == 0 && k % 2 == 0) rough_.push_back(point);
      }
    }
  }
  if (rough_.empty()) rough_ = fine_;
  surface_ = surface_points(initial, surface_mm2_);
}

double PoseSampler::share_of(const std::vector<Vec3>& points, const Pose& pose) const {
  const double pitch = initial_.grid.pitch_mm;
  const Eigen::Matrix3d turn = pose.rotation / pitch;
  const Vec3 shift = (pose.translation - initial_.grid.origin) / pitch + Vec3::Constant(0.5);
  std::size_t common = 0;
  for (const Vec3& point : points) common += initial_.at(turn * point + shift);
  return static_cast<double>(common) / static_cast<double>(std::max<std::size_t>(1, points.size()));
}

PoseBase PoseSampler::base(const Pose& pose) const {
  PoseBase found;
  const double pitch = initial_.grid.pitch_mm;
  for (const Vec3& point : fine_) {
    const Vec3 placed = pose.rotation * point + pose.translation;
    if (placed.z() <= found.highest_z) continue;
    if (initial_.at((placed - initial_.grid.origin) / pitch + Vec3::Constant(0.5))) {
      found.highest_z = placed.z();
    }
  }
  found.lowest_z = found.highest_z;
  const Eigen::Matrix3d back = pose.rotation.transpose();
  for (const Vec3& point : surface_) {
    const Vec3 in_file = back * (point - pose.translation);
    if (!target_.at((in_file - target_.grid.origin) / target_.grid.pitch_mm +
                    Vec3::Constant(0.5))) {
      continue;
    }
    found.area_mm2 += surface_mm2_;
    found.lowest_z = std::min(found.lowest_z, point.z());
  }
  return found;
}

}  // namespace reforge

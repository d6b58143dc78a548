// Sample points of a solid: the centres of the voxels of a regular grid that lie inside it.
//
// Purpose: volumes as counts and connectivity as floods during the search (DESIGN.md, idea 1).
// Units: mm, part frame. Voxel (i, j, k) is centred on origin + pitch * (i, j, k).
// Invariants: points are numbered by k, then j, then i, ascending, so that a range of numbers is a
// slab
//   in z; `number` is the inverse, -1 outside.
// Exactness: inside is decided by winding along z through each column of centres, with one rule for
//   edges shared by triangles, so a closed mesh never leaks. A centre on the surface may fall
//   either way.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "planner/geometry/bit_set.h"
#include "planner/geometry/mesh.h"

namespace reforge {

struct VoxelGrid {
  Vec3 origin = Vec3::Zero();
  double pitch_mm = 1;
  std::array<int, 3> size{0, 0, 0};

  // Covers the box; the lowest centres lie half a pitch above its lowest z.
  static VoxelGrid over(const Box3& box, double pitch_mm);
  Vec3 centre(int i, int j, int k) const { return origin + pitch_mm * Vec3(i, j, k); }
  std::size_t cells() const {
    return static_cast<std::size_t>(size[0]) * size[1] * static_cast<std::size_t>(size[2]);
  }
};

struct VoxelSet {
  VoxelGrid grid;
  std::vector<std::array<int, 3>> voxels;  // (i, j, k) of each point
  std::vector<Vec3> points;                // their centres
  std::vector<std::int32_t> numbers;       // dense over the grid: number of the point, or -1
  // The 26 neighbours of each point, or -1; the 6 that share a face come first.
  std::vector<std::array<std::int32_t, 26>> neighbours;

  std::size_t size() const { return points.size(); }
  std::int32_t number(int i, int j, int k) const;
  // The point whose voxel holds `at`, or -1.
  std::int32_t number_at(const Vec3& at) const;
  double voxel_volume() const { return grid.pitch_mm * grid.pitch_mm * grid.pitch_mm; }
};

VoxelSet sample(const TriangleMesh& solid, const VoxelGrid& grid);
// By cell (k, then j, then i): 1 where the voxel's centre lies inside. The cheap part of sample().
std::vector<std::uint8_t> occupancy(const TriangleMesh& solid, const VoxelGrid& grid);

enum class Connectivity { kFaces = 6, kCorners = 26 };

// Every point of `allowed` connected to one of `seeds` within `allowed` (seeds outside it are
// ignored).
BitSet flood(const VoxelSet& set, const std::vector<std::uint32_t>& seeds, const BitSet& allowed,
             Connectivity connectivity);
// The connected components of `subset`, in order of their lowest number.
std::vector<BitSet> components(const VoxelSet& set, const BitSet& subset,
                               Connectivity connectivity);

}  // namespace reforge

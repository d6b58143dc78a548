#include "planner/blocks/voxel_solid.h"

#include <array>
#include <map>

namespace reforge {
namespace {

// Corners of a voxel's six faces, counter-clockwise seen from outside, as 0/1 offsets.
struct Face {
  std::array<int, 3> outward;
  std::array<std::array<int, 3>, 4> corners;
};
constexpr std::array<Face, 6> kFaces{{
    {{-1, 0, 0}, {{{0, 0, 0}, {0, 0, 1}, {0, 1, 1}, {0, 1, 0}}}},
    {{1, 0, 0}, {{{1, 0, 0}, {1, 1, 0}, {1, 1, 1}, {1, 0, 1}}}},
    {{0, -1, 0}, {{{0, 0, 0}, {1, 0, 0}, {1, 0, 1}, {0, 0, 1}}}},
    {{0, 1, 0}, {{{0, 1, 0}, {0, 1, 1}, {1, 1, 1}, {1, 1, 0}}}},
    {{0, 0, -1}, {{{0, 0, 0}, {0, 1, 0}, {1, 1, 0}, {1, 0, 0}}}},
    {{0, 0, 1}, {{{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}}}},
}};

class Builder {
 public:
  Builder(const VoxelSet& voxels, const BitSet& subset) : voxels_(voxels), subset_(subset) {}

  TriangleMesh build() {
    for (size_t n = 0; n < voxels_.size(); ++n) {
      if (!subset_.test(n)) continue;
      const auto [i, j, k] = voxels_.voxels[n];
      for (const Face& face : kFaces) {
        if (in(i + face.outward[0], j + face.outward[1], k + face.outward[2])) continue;
        std::array<std::uint32_t, 4> v{};
        for (size_t c = 0; c < 4; ++c) {
          const auto& o = face.corners[c];
          v[c] = vertex({i + o[0], j + o[1], k + o[2]}, {i, j, k});
        }
        mesh_.triangles.push_back({v[0], v[1], v[2]});
        mesh_.triangles.push_back({v[0], v[2], v[3]});
      }
    }
    return std::move(mesh_);
  }

 private:
  using Cell = std::array<int, 3>;

  bool in(int i, int j, int k) const {
    const std::int32_t n = voxels_.number(i, j, k);
    return n >= 0 && subset_.test(static_cast<size_t>(n));
  }

  // Which voxels around the grid corner hang together by faces: their lowest one names the group.
  int group(const Cell& corner, const Cell& voxel) const {
    std::array<bool, 8> filled{};
    for (int n = 0; n < 8; ++n) {
      filled[static_cast<size_t>(n)] =
          in(corner[0] - 1 + (n & 1), corner[1] - 1 + (n >> 1 & 1), corner[2] - 1 + (n >> 2 & 1));
    }
    const int self = (voxel[0] - corner[0] + 1) | (voxel[1] - corner[1] + 1) << 1 |
                     (voxel[2] - corner[2] + 1) << 2;
    int seen = 1 << self;
    for (bool grown = true; grown;) {
      grown = false;
      for (int n = 0; n < 8; ++n) {
        if (!(seen >> n & 1)) continue;
        for (const int bit : {1, 2, 4}) {
          const int m = n ^ bit;
          if (filled[static_cast<size_t>(m)] && !(seen >> m & 1)) {
            seen |= 1 << m;
            grown = true;
          }
        }
      }
    }
    return seen;
  }

  std::uint32_t vertex(const Cell& corner, const Cell& voxel) {
    const int together = group(corner, voxel);
    const auto [known, fresh] =
        numbers_.try_emplace({corner[0], corner[1], corner[2], together},
                             static_cast<std::uint32_t>(mesh_.vertices.size()));
    if (!fresh) return known->second;
    Vec3 pull = Vec3::Zero();
    int count = 0, all = 0;
    for (int n = 0; n < 8; ++n) {
      all +=
          in(corner[0] - 1 + (n & 1), corner[1] - 1 + (n >> 1 & 1), corner[2] - 1 + (n >> 2 & 1));
      if (!(together >> n & 1)) continue;
      pull += Vec3((n & 1) - 0.5, (n >> 1 & 1) - 0.5, (n >> 2 & 1) - 0.5);
      ++count;
    }
    const double pitch = voxels_.grid.pitch_mm;
    Vec3 at =
        voxels_.grid.origin + pitch * (Vec3(corner[0], corner[1], corner[2]) - Vec3::Constant(0.5));
    if (count < all) at += 2e-3 * pitch / count * pull;
    mesh_.vertices.push_back(at);
    return known->second;
  }

  const VoxelSet& voxels_;
  const BitSet& subset_;
  TriangleMesh mesh_;
  std::map<std::array<int, 4>, std::uint32_t> numbers_;
};

}  // namespace

TriangleMesh voxel_solid(const VoxelSet& voxels, const BitSet& subset) {
  return Builder(voxels, subset).build();
}

}  // namespace reforge

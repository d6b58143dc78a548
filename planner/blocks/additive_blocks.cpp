#include "planner/blocks/additive_blocks.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "planner/blocks/print_outlook.h"
#include "planner/geometry/height_map.h"
#include "planner/geometry/plane_cut.h"
#include "planner/geometry/voxel_set.h"

namespace reforge {
namespace {

constexpr double kSmallestBlock = 0.05;  // mm^3: less is rounding
constexpr double kWorthACut = 0.03;      // of a part's samples
constexpr double kWorthACutMm3 = 6;
constexpr int kCutsMax = 6;          // one within the other
constexpr double kOrderPitch = 0.8;  // mm, of samples and maps for the order

double distance_to_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 n = (b - a).cross(c - a);
  const double size = n.norm();
  if (size > 1e-12) {
    const bool in = n.dot((b - a).cross(p - a)) >= 0 && n.dot((c - b).cross(p - b)) >= 0 &&
                    n.dot((a - c).cross(p - c)) >= 0;
    if (in) return std::abs(n.dot(p - a)) / size;
  }
  double nearest = 1e300;
  for (const auto& [from, to] : {std::pair{a, b}, std::pair{b, c}, std::pair{c, a}}) {
    const Vec3 way = to - from;
    const double l2 = way.squaredNorm();
    const double t = l2 > 0 ? std::clamp((p - from).dot(way) / l2, 0.0, 1.0) : 0;
    nearest = std::min(nearest, (p - from - t * way).norm());
  }
  return nearest;
}

double distance_to(const TriangleMesh& solid, const Vec3& p) {
  double nearest = 1e300;
  for (const auto& t : solid.triangles) {
    nearest = std::min(nearest, distance_to_triangle(p, solid.vertices[t[0]], solid.vertices[t[1]],
                                                     solid.vertices[t[2]]));
  }
  return nearest;
}

// One part on its base: beyond the planes of the base's facets in turn. What lies beyond the last
// facet only is printed first, since it stands lower than all others' planes.
Status split_on_facets(TriangleMesh part, const PrintingBase& base,
                       std::vector<AdditiveBlock>& out) {
  if (base.facets.size() < 2) {
    out.push_back({std::move(part), base.print_direction});
    return Unit{};
  }
  std::vector<AdditiveBlock> blocks;
  for (const Plane& facet : base.facets) {
    if (part.empty()) break;
    auto halves = split_by(part, facet);
    if (!halves) return halves.error();
    if (volume(halves->second) > kSmallestBlock)
      blocks.push_back({std::move(halves->second), facet.normal});
    part = std::move(halves->first);
  }
  if (volume(part) > kSmallestBlock) blocks.push_back({std::move(part), base.print_direction});
  std::move(blocks.rbegin(), blocks.rend(), std::back_inserter(out));
  return Unit{};
}

// Cuts a block where printing on along another direction makes enough more of it printable. The
// near side stays as it was, the far side stands on the cut.
Status split_for_nozzle(AdditiveBlock block, int cuts_left, PrintOutlook& outlook,
                        std::vector<AdditiveBlock>& out) {
  if (cuts_left > 0) {
    const std::vector<int> samples = outlook.samples_in(block.solid);
    const PrintOutlook::Split split =
        outlook.best_split(samples, outlook.number_of(block.direction));
    const double gain = split.gain * outlook.mm3_per_sample();
    if (gain > kWorthACutMm3 && split.gain > kWorthACut * static_cast<double>(samples.size())) {
      auto halves = split_by(block.solid, split.plane);
      if (!halves) return halves.error();
      auto& [near, far] = *halves;
      if (volume(near) > kSmallestBlock && volume(far) > kSmallestBlock) {
        const Vec3 onwards = outlook.directions()[split.direction];
        const Status done =
            split_for_nozzle({std::move(near), block.direction}, cuts_left - 1, outlook, out);
        if (!done) return done;
        return split_for_nozzle({std::move(far), onwards}, cuts_left - 1, outlook, out);
      }
    }
  }
  out.push_back(std::move(block));
  return Unit{};
}

// How much of each block the nozzle could not lay with another one standing: [block][other], in
// samples.
std::vector<std::vector<size_t>> in_the_way(const std::vector<AdditiveBlock>& blocks,
                                            const Nozzle& nozzle) {
  std::vector<std::vector<size_t>> blocked(blocks.size(), std::vector<size_t>(blocks.size(), 0));
  double widest = 0;
  for (const ToolSection& s : nozzle.body) {
    for (const double r : {s.r_from_mm, s.r_to_mm}) {
      if (std::isfinite(r)) widest = std::max(widest, r);
    }
  }
  for (size_t i = 0; i < blocks.size(); ++i) {
    const VoxelSet samples =
        sample(blocks[i].solid, VoxelGrid::over(bounds(blocks[i].solid), kOrderPitch));
    const Frame frame = Frame::along(blocks[i].direction);
    const HeightGrid grid =
        HeightGrid::over(frame, kOrderPitch, blocks[i].solid.vertices, widest + kOrderPitch);
    for (size_t j = 0; j < blocks.size(); ++j) {
      if (i == j) continue;
      const HeightMap floor =
          tip_heights(upper_envelope(grid, blocks[j].solid, Sampling::kCentres), nozzle.body);
      for (const Vec3& p : samples.points)
        blocked[i][j] += floor.lookup(p) > frame.d.dot(p) + kOrderPitch / 2;
    }
  }
  return blocked;
}

// Next comes the block that is hindered least by what stands and hinders least what is to come.
// Blocks of one part keep their order.
std::vector<size_t> order_of(const std::vector<AdditiveBlock>& blocks,
                             const std::vector<size_t>& part_of, const Nozzle& nozzle) {
  const auto blocked = in_the_way(blocks, nozzle);
  std::vector<size_t> order;
  std::vector<char> placed(blocks.size(), 0);
  while (order.size() < blocks.size()) {
    size_t best = blocks.size(), least = 0;
    for (size_t i = 0; i < blocks.size(); ++i) {
      if (placed[i] || (i > 0 && part_of[i - 1] == part_of[i] && !placed[i - 1])) continue;
      size_t harm = 0;
      for (size_t j = 0; j < blocks.size(); ++j) {
        if (j != i && !placed[j]) harm += blocked[j][i];
      }
      if (best == blocks.size() || harm < least) {
        best = i;
        least = harm;
      }
    }
    placed[best] = 1;
    order.push_back(best);
  }
  return order;
}

}  // namespace

std::vector<TriangleMesh> connected_parts(const TriangleMesh& solid) {
  std::vector<std::uint32_t> root(solid.vertices.size());
  std::iota(root.begin(), root.end(), 0u);
  const auto find = [&](std::uint32_t v) {
    while (root[v] != v) v = root[v] = root[root[v]];
    return v;
  };
  for (const auto& t : solid.triangles) {
    for (const auto v : {t[1], t[2]}) {
      const auto a = find(t[0]), b = find(v);
      root[std::max(a, b)] = std::min(a, b);
    }
  }
  std::vector<std::uint32_t> part_of(solid.vertices.size(), UINT32_MAX);
  std::vector<TriangleMesh> parts;
  std::vector<std::uint32_t> number(solid.vertices.size(), UINT32_MAX);
  for (const auto& t : solid.triangles) {
    std::uint32_t& part = part_of[find(t[0])];
    if (part == UINT32_MAX) {
      part = static_cast<std::uint32_t>(parts.size());
      parts.emplace_back();
    }
    std::array<std::uint32_t, 3> renamed{};
    for (size_t k = 0; k < 3; ++k) {
      if (number[t[k]] == UINT32_MAX) {
        number[t[k]] = static_cast<std::uint32_t>(parts[part].vertices.size());
        parts[part].vertices.push_back(solid.vertices[t[k]]);
      }
      renamed[k] = number[t[k]];
    }
    parts[part].triangles.push_back(renamed);
  }
  // A shell that is inside out bounds a cavity: it goes to the smallest part around it.
  for (size_t i = 0; i < parts.size();) {
    if (volume(parts[i]) >= 0) {
      ++i;
      continue;
    }
    size_t around = parts.size();
    for (size_t j = 0; j < parts.size(); ++j) {
      if (j == i || volume(parts[j]) <= 0 || !bounds(parts[j]).contains(bounds(parts[i]))) continue;
      if (around == parts.size() || volume(parts[j]) < volume(parts[around])) around = j;
    }
    if (around == parts.size()) {
      ++i;
      continue;
    }
    const auto first = static_cast<std::uint32_t>(parts[around].vertices.size());
    parts[around].vertices.insert(parts[around].vertices.end(), parts[i].vertices.begin(),
                                  parts[i].vertices.end());
    for (const auto& t : parts[i].triangles) {
      parts[around].triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
    }
    parts.erase(parts.begin() + static_cast<std::ptrdiff_t>(i));
    i = 0;
  }
  return parts;
}

Result<std::vector<AdditiveBlock>> additive_blocks(const TriangleMesh& added,
                                                   const std::vector<PrintingBase>& bases,
                                                   const Nozzle& nozzle, const PrintScene& scene) {
  if (added.empty()) return std::vector<AdditiveBlock>{};
  std::vector<TriangleMesh> parts = connected_parts(added);
  // Every base belongs to the part it touches; a part is printed from its largest base.
  std::vector<const PrintingBase*> base_of(parts.size(), nullptr);
  for (const PrintingBase& base : bases) {
    size_t nearest = 0;
    double distance = 1e300;
    for (size_t i = 0; i < parts.size(); ++i) {
      const double d = distance_to(parts[i], base.point);
      if (d < distance) {
        distance = d;
        nearest = i;
      }
    }
    const PrintingBase*& chosen = base_of[nearest];
    if (!chosen || base.area_mm2 > chosen->area_mm2) chosen = &base;
  }
  PrintOutlook outlook(scene.target, scene.obstacles, nozzle, scene.directions);
  std::vector<AdditiveBlock> blocks;
  std::vector<size_t> part_of;
  for (size_t i = 0; i < parts.size(); ++i) {
    if (std::abs(volume(parts[i])) < kSmallestBlock) continue;
    PrintingBase upright;
    upright.print_direction = Vec3::UnitZ();
    std::vector<AdditiveBlock> on_facets;
    Status done =
        split_on_facets(std::move(parts[i]), base_of[i] ? *base_of[i] : upright, on_facets);
    for (size_t k = 0; done && k < on_facets.size(); ++k) {
      done = split_for_nozzle(std::move(on_facets[k]), kCutsMax, outlook, blocks);
    }
    if (!done) return done.error();
    part_of.resize(blocks.size(), i);
  }
  if (!scene.blocks_collide) return blocks;
  std::vector<AdditiveBlock> ordered;
  for (const size_t i : order_of(blocks, part_of, nozzle)) ordered.push_back(std::move(blocks[i]));
  return ordered;
}

}  // namespace reforge

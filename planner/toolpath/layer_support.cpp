#include "planner/toolpath/layer_support.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace reforge {
namespace {

constexpr double kGroundPitch = 0.15;   // mm, of the map of what carries the block
constexpr double kStandingPitch = 0.3;  // mm, of what stands around it
constexpr double kNodePitch = 0.125;    // mm, of masks; more for blocks beyond kNodesMax
constexpr double kNodesMax = 1e6;
constexpr double kOverhang = 0.3;        // mm a layer may reach beyond the one below
constexpr double kGroundReach = 0.15;    // mm below a layer's underside where ground still carries
constexpr double kHop = 0.5;             // mm above the layer while travelling
constexpr double kNozzleGap = 0.1;       // mm kept between nozzle and obstacles, beside and below
constexpr double kSmallestPiece = 0.06;  // mm^2 of a layer worth trimming
constexpr double kSpeck = 0.2;           // mm: narrower pieces of solid fill are not worth lines
constexpr double kBeadStep = 0.1;        // mm between points of a bead

double widest(const DepositionOptions& options) {
  double radius = options.outlet_radius_mm;
  for (const ToolSection& s : options.nozzle.body) {
    for (const double r : {s.r_from_mm, s.r_to_mm}) {
      if (std::isfinite(r)) radius = std::max(radius, r);
    }
  }
  return radius;
}

double highest(const std::vector<const TriangleMesh*>& solids, const Frame& frame) {
  double top = HeightMap::kEmpty;
  for (const TriangleMesh* solid : solids) {
    for (const Vec3& v : solid->vertices) top = std::max(top, frame.d.dot(v));
  }
  return top;
}

float look_up(const HeightMap& map, const Vec2& p) {
  const HeightGrid& g = map.grid;
  const int column = static_cast<int>(std::floor((p.x() - g.u0) / g.pitch_mm + 0.5));
  const int row = static_cast<int>(std::floor((p.y() - g.v0) / g.pitch_mm + 0.5));
  return map.contains(column, row) ? map.at(column, row) : HeightMap::kEmpty;
}

// Raises the map to the beads of a block: points across their width and through their height.
void raise_to_beads(HeightMap& map, const BlockToolpath& block, const Extrusion& e) {
  const Frame& onto = map.grid.frame;
  const HeightGrid& g = map.grid;
  for (const Path& path : block.paths) {
    for (std::size_t i = 1; i < path.moves.size(); ++i) {
      if (path.moves[i].motion != Motion::kDeposit && path.moves[i].motion != Motion::kCoast)
        continue;
      const Vec3 a = path.moves[i - 1].to, b = path.moves[i].to;
      const double length = (b - a).norm();
      if (length < 1e-9) continue;
      const Vec3 along = (b - a) / length, across(-along.y(), along.x(), 0);
      const int steps = std::max(1, static_cast<int>(std::ceil(length / kBeadStep)));
      for (int s = 0; s <= steps; ++s) {
        for (int w = -2; w <= 2; ++w) {
          const Vec3 top =
              a + (b - a) * (static_cast<double>(s) / steps) + across * (w * e.bead_width_mm / 4.2);
          for (const double down : {0.0, 0.5, 1.0}) {
            const Vec3 at =
                onto.to_local(block.frame.to_part(top - Vec3(0, 0, down * e.layer_height_mm)));
            const int column = static_cast<int>(std::floor((at.x() - g.u0) / g.pitch_mm + 0.5));
            const int row = static_cast<int>(std::floor((at.y() - g.v0) / g.pitch_mm + 0.5));
            if (!map.contains(column, row)) continue;
            float& height = map.at(column, row);
            height = std::max(height, static_cast<float>(at.z()));
          }
        }
      }
    }
  }
}

}  // namespace

LayerSupport::LayerSupport(const DepositionOptions& options, const TriangleMesh& block,
                           const Frame& frame, const PrintSite& site)
    : options_(options),
      slices_(slice(block, frame, options.extrusion.layer_height_mm)),
      ground_(HeightGrid::over(frame, kGroundPitch, block.vertices, 2)),
      standing_(HeightGrid::over(frame, kStandingPitch, block.vertices, widest(options) + 1)),
      nozzle_floor_(standing_) {
  for (const TriangleMesh* solid : site.ground) raise_to(ground_, *solid, Sampling::kCentres);
  for (const BlockToolpath& printed : site.printed) {
    if (printed.kind == BlockKind::kPrint) raise_to_beads(ground_, printed, options.extrusion);
  }
  // The nozzle reaches wider than the block: what stands around it counts as far as its body goes.
  for (const TriangleMesh* solid : site.obstacles)
    raise_to(standing_, *solid, Sampling::kConservative);
  std::vector<ToolSection> body = options.nozzle.body;
  for (ToolSection& section : body) {
    section.z_from_mm -= kNozzleGap;
    section.z_to_mm -= kNozzleGap;
  }
  nozzle_floor_ = tip_heights(standing_, body, kNozzleGap);
  // A section without end meets whatever stands highest, however far away.
  for (const ToolSection& section : body) {
    if (std::isfinite(section.r_from_mm)) continue;
    const double limit = highest(site.obstacles, frame) - section.z_from_mm;
    for (float& height : nozzle_floor_.heights)
      height = std::max(height, static_cast<float>(limit));
  }
  Vec2 low(1e300, 1e300), high(-1e300, -1e300);
  for (const Vec3& v : block.vertices) {
    const Vec2 p(frame.u.dot(v), frame.v.dot(v));
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double pitch = std::max(kNodePitch, std::sqrt((high - low).prod() / kNodesMax));
  grid_ = PlaneGrid::covering(low - Vec2(0.5, 0.5), high + Vec2(0.5, 0.5), pitch);
}

float LayerSupport::ground_at(const Vec2& p) const {
  return look_up(ground_, p);
}

PlaneMask LayerSupport::ground_band(const PlaneMask& within, double tip) const {
  PlaneMask band(grid_);
  const double low = tip - slices_.layer_height - kGroundReach, high = tip + kGroundReach;
  for (int r = 0; r < grid_.rows; ++r) {
    for (int c = 0; c < grid_.columns; ++c) {
      const std::size_t node = grid_.index(c, r);
      if (!within.test(node)) continue;
      const float top = look_up(ground_, grid_.node(c, r));
      band.set(node, top > low && top < high);
    }
  }
  return band;
}

LayerSupport::Layer LayerSupport::next_layer(std::size_t k) {
  Layer layer{slices_.layers[k], PlaneMask(grid_), PlaneMask(grid_)};
  const PlaneMask whole = PlaneMask::of(layer.region, grid_);
  if (layer.region.empty()) return layer;
  const double tip = slices_.top_of(k), all = area(layer.region);
  const Layer* below = k > 0 ? known(k - 1) : nullptr;
  const PlaneMask on_ground = ground_band(whole, tip).grown(kOverhang);
  PlaneMask lost = whole;
  lost.subtract(on_ground);
  if (below) lost.subtract(below->mask.grown(kOverhang));
  layer.mask = whole;
  if (lost.area() > kSmallestPiece) {
    PlaneRegion carried = common(layer.region, on_ground.outline());
    if (below && !below->region.empty())
      carried = united(carried, common(layer.region, offset(below->region, kOverhang)));
    layer.region = std::move(carried);
    layer.mask = PlaneMask::of(layer.region, grid_);
  }
  PlaneMask blocked(grid_);
  for (int r = 0; r < grid_.rows; ++r) {
    for (int c = 0; c < grid_.columns; ++c) {
      const std::size_t node = grid_.index(c, r);
      if (layer.mask.test(node) && look_up(nozzle_floor_, grid_.node(c, r)) > tip + 1e-4)
        blocked.set(node, true);
    }
  }
  layer.carried = layer.mask;
  if (!blocked.none()) {
    any_blocked_ = true;
    layer.region = without(layer.region, blocked.grown(1.2 * grid_.pitch).outline());
    layer.mask = PlaneMask::of(layer.region, grid_);
  }
  if (any_blocked_ && below) {
    PlaneMask would = below->carried.grown(kOverhang);
    layer.carried |= (would &= whole);
  }
  const double missing = (all - area(layer.region)) * slices_.layer_height;
  PlaneMask reachable = layer.carried;
  const double for_nozzle =
      std::min(missing, reachable.subtract(layer.mask).area() * slices_.layer_height);
  blocked_mm3_ += for_nozzle;
  unsupported_mm3_ += missing - for_nozzle;
  return layer;
}

const LayerSupport::Layer* LayerSupport::known(std::size_t k) {
  if (k >= slices_.layers.size()) return nullptr;
  assert(k >= first_);
  while (first_ + layers_.size() <= k) layers_.push_back(next_layer(first_ + layers_.size()));
  return &layers_[k - first_];
}

const PlaneRegion& LayerSupport::printable(std::size_t k) {
  const auto reach = static_cast<std::size_t>(options_.solid_layers);
  while (!layers_.empty() && first_ + reach < k) {
    layers_.pop_front();
    ++first_;
  }
  return known(k)->region;
}

PlaneRegion LayerSupport::solid(std::size_t k) {
  known(std::min(k + static_cast<std::size_t>(options_.solid_layers), layers() - 1));
  const Layer& layer = *known(k);
  if (k == 0) return layer.region;  // a whole layer for the hold on the ground
  PlaneMask hidden = layer.mask;
  for (int d = 1; d <= options_.solid_layers; ++d) {
    const Layer* above = known(k + static_cast<std::size_t>(d));
    hidden &= above ? above->mask : PlaneMask(grid_);
  }
  PlaneMask hangs = layer.mask;
  PlaneMask carried = layer.mask;
  for (int d = 1; d <= options_.solid_layers && static_cast<std::size_t>(d) <= k; ++d)
    carried &= known(k - static_cast<std::size_t>(d))->mask.grown(grid_.pitch);
  hangs.subtract(carried);
  const double bottom = slices_.top_of(k) - slices_.layer_height;
  const double reach = options_.solid_layers * slices_.layer_height;
  for (int r = 0; r < grid_.rows; ++r) {
    for (int c = 0; c < grid_.columns; ++c) {
      const std::size_t node = grid_.index(c, r);
      if (hangs.test(node) && look_up(ground_, grid_.node(c, r)) > bottom - reach)
        hangs.set(node, false);
    }
  }
  PlaneMask shows = layer.mask;
  shows.subtract(hidden);
  shows |= hangs;
  return shows.shrunk(kSpeck).grown(kSpeck + grid_.pitch / 2).outline();
}

double LayerSupport::travel_height(const Vec2& a, const Vec2& b, double tip) const {
  double height = tip + kHop;
  const int steps = std::max(1, static_cast<int>(std::ceil((b - a).norm() / kStandingPitch)));
  for (int i = 0; i <= steps; ++i) {
    const Vec2 p = a + (b - a) * (static_cast<double>(i) / steps);
    height = std::max<double>(height, look_up(nozzle_floor_, p) + kHop);
    height = std::max<double>(height, look_up(standing_, p) + kHop);
  }
  return height;
}

}  // namespace reforge

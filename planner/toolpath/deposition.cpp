#include "planner/toolpath/deposition.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "planner/toolpath/arc_length.h"
#include "planner/toolpath/bead_cover.h"
#include "planner/toolpath/bead_layout.h"
#include "planner/toolpath/level_region.h"
#include "planner/toolpath/slicing.h"

namespace reforge {
namespace {

constexpr double kMapPitch = 0.3;      // mm, of what stands around the block
constexpr double kOverhang = 0.3;      // mm a layer may reach beyond the one below
constexpr double kGroundReach = 0.15;  // mm below a layer's underside where ground still carries it
constexpr double kBridge = 2.0;        // mm a bead may span
constexpr double kHop = 0.5;           // mm above the layer while travelling
constexpr double kNozzleGap = 0.1;     // mm kept between nozzle and obstacles, beside and below
constexpr double kSmallestPiece = 0.02;  // mm^2

class Depositor {
 public:
  Depositor(const DepositionOptions& options, const TriangleMesh& block, const Frame& frame,
            const std::vector<const TriangleMesh*>& ground,
            const std::vector<const TriangleMesh*>& obstacles)
      : options_(options),
        slices_(slice(block, frame, options.extrusion.layer_height_mm)),
        ground_(HeightGrid::over(frame, kMapPitch, block.vertices, 2)),
        standing_(ground_),
        nozzle_floor_(ground_) {
    // The nozzle reaches wider than the block: what stands around it counts as far as its body
    // goes.
    HeightGrid wide = HeightGrid::over(frame, kMapPitch, block.vertices, widest() + 1);
    HeightMap around(wide);
    for (const TriangleMesh* solid : ground) raise_to(ground_, *solid, Sampling::kCentres);
    for (const TriangleMesh* solid : obstacles) raise_to(around, *solid, Sampling::kConservative);
    std::vector<ToolSection> body = options.nozzle.body;
    for (ToolSection& section : body) {
      section.z_from_mm -= kNozzleGap;
      section.z_to_mm -= kNozzleGap;
    }
    standing_ = around;
    nozzle_floor_ = tip_heights(around, body, kNozzleGap);
    // A section without end meets whatever stands highest, however far away.
    for (const ToolSection& section : body) {
      if (std::isfinite(section.r_from_mm)) continue;
      const double limit = highest(obstacles, frame) - section.z_from_mm;
      for (float& height : nozzle_floor_.heights)
        height = std::max(height, static_cast<float>(limit));
    }
  }

  Deposition run(const std::function<bool()>& interrupted) {
    result_.layers = static_cast<int>(slices_.layers.size());
    std::vector<PlaneRegion> printable(slices_.layers.size());
    find_printable(printable, interrupted);
    for (size_t k = 0; k < printable.size() && !interrupted(); ++k) {
      if (!printable[k].empty()) print(k, printable);
    }
    return std::move(result_);
  }

 private:
  double widest() const {
    double radius = options_.outlet_radius_mm;
    for (const ToolSection& s : options_.nozzle.body) {
      for (const double r : {s.r_from_mm, s.r_to_mm}) {
        if (std::isfinite(r)) radius = std::max(radius, r);
      }
    }
    return radius;
  }

  static double highest(const std::vector<const TriangleMesh*>& solids, const Frame& frame) {
    double top = HeightMap::kEmpty;
    for (const TriangleMesh* solid : solids) {
      for (const Vec3& v : solid->vertices) top = std::max(top, frame.d.dot(v));
    }
    return top;
  }

  static float look_up(const HeightMap& map, const Vec2& p) {
    const HeightGrid& g = map.grid;
    const int column = static_cast<int>(std::floor((p.x() - g.u0) / g.pitch_mm + 0.5));
    const int row = static_cast<int>(std::floor((p.y() - g.v0) / g.pitch_mm + 0.5));
    return map.contains(column, row) ? map.at(column, row) : HeightMap::kEmpty;
  }

  // The part of a region where the rule on a map's cells holds.
  PlaneRegion where(const HeightMap& map, const PlaneRegion& within,
                    const std::function<bool(float)>& rule) const {
    Vec2 low(1e300, 1e300), high(-1e300, -1e300);
    for (const Polyline& ring : within.rings) {
      for (const Vec2& p : ring) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
      }
    }
    const double pitch = map.grid.pitch_mm;
    const PlaneGrid grid =
        PlaneGrid::covering(low - Vec2(pitch, pitch), high + Vec2(pitch, pitch), pitch);
    std::vector<char> nodes(grid.size());
    bool any = false, all = true;
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        const bool holds = rule(look_up(map, grid.node(c, r)));
        nodes[grid.index(c, r)] = holds;
        any |= holds;
        all &= holds;
      }
    }
    if (!any) return {};
    if (all) return within;
    return common(within,
                  region_where(grid, nodes, [&](const Vec2& p) { return rule(look_up(map, p)); }));
  }

  // The part of layer k that lies on `below` or on ground.
  PlaneRegion carried_part(size_t k, const PlaneRegion& layer, const PlaneRegion& below) const {
    if (layer.empty()) return layer;
    const double height = slices_.layer_height, tip = slices_.top_of(k);
    PlaneRegion carried = below.empty() ? PlaneRegion{} : common(layer, offset(below, kOverhang));
    if (area(layer) - area(carried) < kSmallestPiece) return carried;
    const PlaneRegion on_ground = where(ground_, layer, [&](float top) {
      return top > tip - height - kGroundReach && top < tip + kGroundReach;
    });
    if (on_ground.empty()) return carried;
    return united(carried, common(layer, offset(on_ground, kOverhang)));
  }

  // Fills `printable`. What hangs counts as unsupported; what only hangs because the nozzle could
  // not lay what is below it counts as blocked.
  void find_printable(std::vector<PlaneRegion>& printable,
                      const std::function<bool()>& interrupted) {
    PlaneRegion carried;
    for (size_t k = 0; k < slices_.layers.size() && !interrupted(); ++k) {
      const PlaneRegion& layer = slices_.layers[k];
      carried = carried_part(k, layer, carried);
      result_.unsupported_mm3 += (area(layer) - area(carried)) * slices_.layer_height;
      const PlaneRegion below = k > 0 ? printable[k - 1] : PlaneRegion{};
      printable[k] = carried_part(k, carried, below);
      if (!printable[k].empty()) {
        const double tip = slices_.top_of(k);
        printable[k] =
            where(nozzle_floor_, printable[k], [&](float floor) { return floor <= tip + 1e-4; });
      }
      result_.blocked_mm3 += (area(carried) - area(printable[k])) * slices_.layer_height;
    }
  }

  // What shows within a few layers above or below; what rests on ground or lies under it does not
  // show.
  PlaneRegion solid_part(size_t k, const std::vector<PlaneRegion>& printable) const {
    PlaneRegion covered = printable[k];
    for (int d = 1; d <= options_.solid_layers && !covered.empty(); ++d) {
      const size_t above = k + static_cast<size_t>(d);
      covered = above < printable.size() ? common(covered, printable[above]) : PlaneRegion{};
    }
    PlaneRegion shows = without(printable[k], covered);
    if (k == 0) return printable[k];  // a whole layer for the hold on the ground
    PlaneRegion carried = printable[k];
    for (int d = 1; d <= options_.solid_layers && !carried.empty(); ++d) {
      if (static_cast<size_t>(d) > k) break;
      carried = common(carried, offset(printable[k - static_cast<size_t>(d)], 0.05));
    }
    PlaneRegion hangs = without(printable[k], carried);
    if (!hangs.empty()) {
      const double bottom = slices_.top_of(k) - slices_.layer_height;
      const double reach = options_.solid_layers * slices_.layer_height;
      hangs =
          without(hangs, where(ground_, hangs, [&](float top) { return top > bottom - reach; }));
    }
    return united(shows, hangs);
  }

  void print(size_t k, const std::vector<PlaneRegion>& printable) {
    const Extrusion& e = options_.extrusion;
    const PlaneRegion solid = solid_part(k, printable);
    const BeadOptions beads{e.bead_width_mm, e.infill, options_.walls};
    std::vector<Bead> layer = lay_beads(printable[k], solid, k % 2 == 1, beads);
    const PlaneRegion interior = offset(printable[k], -options_.walls * e.bead_width_mm);
    const double whole = area(common(interior, solid));
    result_.planned_mm3 += slices_.layer_height * (area(printable[k]) - area(interior) + whole +
                                                   e.infill * (area(interior) - whole));
    const double tip = slices_.top_of(k);
    const HeightGrid& g = ground_.grid;
    BeadCover cover(Vec2(g.u0, g.v0),
                    Vec2(g.u0 + g.columns * g.pitch_mm, g.v0 + g.rows * g.pitch_mm));
    const double bottom = tip - slices_.layer_height;
    const auto carries = [&](const Vec2& p) {
      return (below_ && below_->covered(p)) || look_up(ground_, p) > bottom - kGroundReach;
    };
    double lost = 0;
    for (Bead& bead : layer) {
      if (bead.closed) start_at_seam(bead.line);
      for (const Bead& part : carried_parts(bead, e.bead_width_mm, kBridge, carries, lost)) {
        lay(part, tip, k == 0);
        cover.stamp(part, e.bead_width_mm);
      }
    }
    result_.hanging_mm3 += lost * e.bead_width_mm * slices_.layer_height;
    below_ = std::move(cover);
  }

  // Seams lie in one line up the block, on its side away from the operator (largest v).
  static void start_at_seam(Polyline& ring) {
    const auto seam = std::max_element(ring.begin(), ring.end(), [](const Vec2& a, const Vec2& b) {
      return a.y() != b.y() ? a.y() < b.y() : a.x() < b.x();
    });
    std::rotate(ring.begin(), seam, ring.end());
  }

  double travel_height(const Vec2& a, const Vec2& b, double tip) const {
    double height = tip + kHop;
    const int steps = std::max(1, static_cast<int>(std::ceil((b - a).norm() / kMapPitch)));
    for (int i = 0; i <= steps; ++i) {
      const Vec2 p = a + (b - a) * (static_cast<double>(i) / steps);
      height = std::max<double>(height, look_up(nozzle_floor_, p) + kHop);
      height = std::max<double>(height, look_up(standing_, p) + kHop);
    }
    return height;
  }

  void lay(const Bead& bead, double tip, bool first_layer) {
    const ArcLength<Vec2> walk(bead.line, bead.closed);
    const double total = walk.length();
    const double coast = std::min(options_.extrusion.coast_mm, total / 4);
    Path path;
    path.first_layer = first_layer;
    const auto at = [&](const Vec2& p, double height) { return Vec3(p.x(), p.y(), height); };
    const Vec2 start = bead.line.front();
    if (result_.paths.empty()) {
      path.moves.push_back({at(start, travel_height(start, start, tip)), Motion::kRapid});
    } else {
      const Vec3 from = result_.paths.back().moves.back().to;
      const Vec2 over(from.x(), from.y());
      const double height = std::max(travel_height(over, start, tip), from.z());
      path.moves.push_back({at(over, height), Motion::kRapid});
      path.moves.push_back({at(start, height), Motion::kRapid});
    }
    path.moves.push_back({at(start, tip), Motion::kRapid});
    Polyline line = bead.line;
    if (bead.closed) line.push_back(start);
    double gone = 0;
    const double stop = total - coast;
    for (size_t i = 1; i < line.size(); ++i) {
      const double piece = (line[i] - line[i - 1]).norm();
      if (gone < stop - 1e-9 && gone + piece > stop + 1e-9) {
        path.moves.push_back({at(walk.at(stop), tip), Motion::kDeposit});
      }
      gone += piece;
      path.moves.push_back(
          {at(line[i], tip), gone <= stop + 1e-9 ? Motion::kDeposit : Motion::kCoast});
    }
    result_.bead_mm3 += total * options_.extrusion.bead_width_mm * slices_.layer_height;
    result_.paths.push_back(std::move(path));
  }

  const DepositionOptions& options_;
  const Slices slices_;
  HeightMap ground_;                // what carries the block, at cell centres
  HeightMap standing_;              // what the nozzle must clear
  HeightMap nozzle_floor_;          // lowest tip there
  std::optional<BeadCover> below_;  // the layer before
  Deposition result_;
};

}  // namespace

DepositionOptions deposition_options(const RigDescription& rig, Mode mode) {
  DepositionOptions options;
  options.extrusion = rig.extrusion;
  options.nozzle = nozzle_of(rig, mode);
  options.outlet_radius_mm = rig.nozzle.outlet_diameter_mm / 2;
  return options;
}

Deposition deposit(const DepositionOptions& options, const TriangleMesh& block, const Frame& frame,
                   const std::vector<const TriangleMesh*>& ground,
                   const std::vector<const TriangleMesh*>& obstacles,
                   const std::function<bool()>& interrupted) {
  if (block.empty()) return {};
  return Depositor(options, block, frame, ground, obstacles).run(interrupted);
}

}  // namespace reforge

#include "planner/toolpath/deposition.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "planner/toolpath/arc_length.h"
#include "planner/toolpath/bead_cover.h"
#include "planner/toolpath/bead_layout.h"
#include "planner/toolpath/layer_support.h"

namespace reforge {
namespace {

constexpr double kGroundReach = 0.15;  // mm below a layer's underside where ground still carries it
constexpr double kBridge = 2.0;        // mm a bead may span
constexpr double kSeamClear = 0.8;     // mm between a seam and what stands beside the layer

class Depositor {
 public:
  Depositor(const DepositionOptions& options, const TriangleMesh& block, const Frame& frame,
            const PrintSite& site)
      : options_(options), support_(options, block, frame, site) {
    for (const Vec3& v : block.vertices) {
      const Vec2 p(frame.u.dot(v), frame.v.dot(v));
      low_ = low_.cwiseMin(p);
      high_ = high_.cwiseMax(p);
    }
  }

  Deposition run(const std::function<bool()>& interrupted) {
    result_.layers = static_cast<int>(support_.layers());
    for (std::size_t k = 0; k < support_.layers() && !interrupted(); ++k) {
      const PlaneRegion& layer = support_.printable(k);
      if (layer.empty()) {
        below_.reset();
      } else {
        print(k, layer);
      }
    }
    result_.unsupported_mm3 = support_.unsupported_mm3();
    result_.blocked_mm3 = support_.blocked_mm3();
    return std::move(result_);
  }

 private:
  void print(std::size_t k, const PlaneRegion& layer) {
    const Extrusion& e = options_.extrusion;
    const double height = support_.slices().layer_height;
    const PlaneRegion solid = support_.solid(k);
    const BeadOptions layout{e.bead_width_mm, e.infill, options_.walls};
    std::vector<Bead> beads = lay_beads(layer, solid, k % 2 == 1, layout);
    const PlaneRegion interior = offset(layer, -options_.walls * e.bead_width_mm);
    const double whole = solid.empty() ? 0 : area(common(interior, solid));
    result_.planned_mm3 +=
        height * (area(layer) - area(interior) + whole + e.infill * (area(interior) - whole));
    const double tip = support_.slices().top_of(k), bottom = tip - height;
    BeadCover cover(low_, high_);
    const auto carries = [&](const Vec2& p) {
      return (below_ && below_->covered(p)) ||
             static_cast<double>(support_.ground_at(p)) > bottom - kGroundReach;
    };
    double lost = 0, length = 0;
    std::vector<Bead> laid;
    for (Bead& bead : beads) {
      if (bead.closed) start_at_seam(bead.line, bottom);
      for (Bead& part : carried_parts(bead, e.bead_width_mm, kBridge, carries, lost)) {
        cover.stamp(part, e.bead_width_mm);
        length += length_of(part.line, part.closed);
        laid.push_back(std::move(part));
      }
    }
    const double feed = k == 0 ? e.first_layer_feed_mm_per_s : e.feed_mm_per_s;
    const double share =
        std::clamp(length / (feed * options_.layer_s_min), options_.slowest_feed, 1.0);
    for (const Bead& part : laid) lay(part, tip, k == 0, share);
    result_.hanging_mm3 += lost * e.bead_width_mm * height;
    below_ = std::move(cover);
  }

  // Seams lie in one line up the block, on its side away from the operator (largest v), but not
  // where V_R or another block stands beside the layer.
  void start_at_seam(Polyline& ring, double bottom) const {
    const auto beside = [&](const Vec2& p) {
      for (int k = 0; k < 8; ++k) {
        const double angle = std::numbers::pi * k / 4;
        const Vec2 q = p + kSeamClear * Vec2(std::cos(angle), std::sin(angle));
        if (static_cast<double>(support_.ground_at(q)) > bottom + kGroundReach) return true;
      }
      return false;
    };
    auto best = ring.end();
    for (const bool anywhere : {false, true}) {
      for (auto p = ring.begin(); p != ring.end(); ++p) {
        const bool farther =
            best == ring.end() || p->y() > best->y() || (p->y() == best->y() && p->x() > best->x());
        if (farther && (anywhere || !beside(*p))) best = p;
      }
      if (best != ring.end()) break;
    }
    std::rotate(ring.begin(), best, ring.end());
  }

  void lay(const Bead& bead, double tip, bool first_layer, double feed_share) {
    const ArcLength<Vec2> walk(bead.line, bead.closed);
    const double total = walk.length();
    const double coast = std::min(options_.extrusion.coast_mm, total / 4);
    Path path;
    path.first_layer = first_layer;
    path.feed_share = feed_share;
    const auto at = [&](const Vec2& p, double height) { return Vec3(p.x(), p.y(), height); };
    const Vec2 start = bead.line.front();
    if (result_.paths.empty()) {
      path.moves.push_back({at(start, support_.travel_height(start, start, tip)), Motion::kRapid});
    } else {
      const Vec3 from = result_.paths.back().moves.back().to;
      const Vec2 over(from.x(), from.y());
      const double height = std::max(support_.travel_height(over, start, tip), from.z());
      path.moves.push_back({at(over, height), Motion::kRapid});
      path.moves.push_back({at(start, height), Motion::kRapid});
    }
    path.moves.push_back({at(start, tip), Motion::kRapid});
    Polyline line = bead.line;
    if (bead.closed) line.push_back(start);
    double gone = 0;
    const double stop = total - coast;
    for (std::size_t i = 1; i < line.size(); ++i) {
      const double piece = (line[i] - line[i - 1]).norm();
      if (gone < stop - 1e-9 && gone + piece > stop + 1e-9) {
        path.moves.push_back({at(walk.at(stop), tip), Motion::kDeposit});
      }
      gone += piece;
      path.moves.push_back(
          {at(line[i], tip), gone <= stop + 1e-9 ? Motion::kDeposit : Motion::kCoast});
    }
    result_.bead_mm3 += total * options_.extrusion.bead_width_mm * support_.slices().layer_height;
    result_.paths.push_back(std::move(path));
  }

  const DepositionOptions& options_;
  LayerSupport support_;
  Vec2 low_ = Vec2(1e300, 1e300), high_ = Vec2(-1e300, -1e300);
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
                   const PrintSite& site, const std::function<bool()>& interrupted) {
  if (block.empty()) return {};
  return Depositor(options, block, frame, site).run(interrupted);
}

}  // namespace reforge

#include "planner/toolpath/roughing.h"

#include <algorithm>
#include <cmath>

#include "planner/toolpath/arc_length.h"
#include "planner/toolpath/level_region.h"

namespace reforge {
namespace {

constexpr double kContourPitch = 0.4;  // mm between nodes of a level's grid
constexpr double kContourTolerance = 0.01;
constexpr double kSampleStep = 0.4;  // mm along a contour when asking what it would cut
constexpr double kAirGap = 3.0;      // contours go on through air for this long
constexpr double kApproach = 0.3;    // mm above stock that counts as air
constexpr double kOverEdge = 0.5;  // of the ball's radius: how far contours reach over rest's edge

struct Piece {
  Polyline line;
  bool closed;
};

class Level {
 public:
  Level(const MillingOptions& options, const TipFloor& floor, BlockStock& stock, double height)
      : options_(options),
        floor_(floor),
        stock_(stock),
        clearance_(stock.standing(), options.cutter),
        z_(height) {}

  // Contours in the order of their offsets, cut down to what they would remove.
  std::vector<Piece> contours() const {
    std::vector<Piece> pieces;
    const PlaneRegion need = rest_region();
    if (need.empty()) return pieces;
    PlaneRegion region =
        common(allowed_near(need), offset(need, options_.cutter.ball_radius_mm * kOverEdge));
    for (int k = 0; k < 10000; ++k) {
      region = offset(region, k == 0 ? -1e-3 : -options_.stepover_mm);
      if (region.empty()) break;
      for (const Polyline& ring : region.rings) {
        const Polyline contour = simplified(ring, kContourTolerance, true);
        if (contour.size() > 2) keep_cutting_parts(contour, pieces);
      }
    }
    return pieces;
  }

  void cut(std::vector<Piece> pieces, std::vector<Path>& paths) {
    PathWriter writer(stock_, clearance_, paths);
    std::vector<char> done(pieces.size(), 0);
    for (size_t n = 0; n < pieces.size(); ++n) {
      size_t next = pieces.size();
      double nearest = 1e300;
      for (size_t i = 0; i < pieces.size(); ++i) {
        if (done[i]) continue;
        double d = 0;
        if (writer.at_work()) d = nearest_start(pieces[i], writer.position());
        if (d < nearest) {
          nearest = d;
          next = i;
        }
      }
      done[next] = 1;
      if (!still_cuts(pieces[next])) continue;
      if (writer.at_work()) start_near(pieces[next], writer.position());
      follow(pieces[next], nearest, writer);
    }
  }

 private:
  bool allowed(const Vec2& p) const {
    return clearance_.holder_floor(p.x(), p.y()) <= z_ && floor_.allows(p.x(), p.y(), z_);
  }

  PlaneRegion rest_region() const {
    const HeightGrid& g = stock_.grid();
    PlaneGrid grid;
    grid.pitch = g.pitch_mm;
    grid.origin = Vec2(g.u0, g.v0);
    grid.columns = g.columns;
    grid.rows = g.rows;
    std::vector<char> nodes(grid.size(), 0);
    bool any = false;
    for (int row = 0; row < grid.rows; ++row) {
      for (int column = 0; column < grid.columns; ++column) {
        const bool rest = stock_.rest_above_cell(column, row, z_);
        nodes[grid.index(column, row)] = rest;
        any |= rest;
      }
    }
    if (!any) return {};
    return region_where(grid, nodes,
                        [&](const Vec2& p) { return stock_.rest_above(p.x(), p.y(), z_); });
  }

  // Where the tip may be at this height, exact near `need` and empty far from it.
  PlaneRegion allowed_near(const PlaneRegion& need) const {
    Vec2 low(1e300, 1e300), high(-1e300, -1e300);
    for (const Polyline& ring : need.rings) {
      for (const Vec2& p : ring) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
      }
    }
    const double reach = options_.cutter.ball_radius_mm;
    const PlaneGrid grid =
        PlaneGrid::covering(low - Vec2(reach, reach), high + Vec2(reach, reach), kContourPitch);
    // Nodes within reach of rest: the others need no answer.
    std::vector<char> nodes(grid.size(), 0);
    const int spread = static_cast<int>(std::ceil(reach / grid.pitch)) + 1;
    std::vector<char> rest(grid.size(), 0), near_rest(grid.size(), 0);
    const HeightGrid& cells = stock_.grid();
    for (int row = 0; row < cells.rows; ++row) {
      for (int column = 0; column < cells.columns; ++column) {
        if (!stock_.rest_above_cell(column, row, z_)) continue;
        const Vec2 p(cells.u0 + column * cells.pitch_mm, cells.v0 + row * cells.pitch_mm);
        const int c = static_cast<int>(std::lround((p.x() - grid.origin.x()) / grid.pitch));
        const int r = static_cast<int>(std::lround((p.y() - grid.origin.y()) / grid.pitch));
        if (c >= 0 && r >= 0 && c < grid.columns && r < grid.rows) rest[grid.index(c, r)] = 1;
      }
    }
    // A square spread, rows then columns.
    std::vector<char> rows_spread(grid.size(), 0);
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        if (!rest[grid.index(c, r)]) continue;
        for (int k = std::max(0, c - spread); k <= std::min(grid.columns - 1, c + spread); ++k) {
          rows_spread[grid.index(k, r)] = 1;
        }
      }
    }
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        if (!rows_spread[grid.index(c, r)]) continue;
        for (int k = std::max(0, r - spread); k <= std::min(grid.rows - 1, r + spread); ++k) {
          near_rest[grid.index(c, k)] = 1;
        }
      }
    }
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        const size_t i = grid.index(c, r);
        nodes[i] = near_rest[i] && allowed(grid.node(c, r));
      }
    }
    return region_where(grid, nodes, [&](const Vec2& p) { return allowed(p); });
  }

  Vec3 tip(const Vec2& p) const { return {p.x(), p.y(), z_}; }

  // The pieces of a contour along which rest would be removed, bridging short gaps.
  void keep_cutting_parts(const Polyline& contour, std::vector<Piece>& out) const {
    const ArcLength<Vec2> walk(contour, true);
    const double total = walk.length();
    const int count = std::max(8, static_cast<int>(std::ceil(total / kSampleStep)));
    std::vector<char> cuts(count, 0);
    int cutting = 0;
    for (int i = 0; i < count; ++i) {
      cuts[i] = stock_.rest_depth(tip(walk.at(total * i / count))) > 0.03;
      cutting += cuts[i];
    }
    if (cutting == 0) return;
    const int gap = static_cast<int>(kAirGap / (total / count));
    int start = -1, quiet = 0;  // a place after a long quiet stretch, if there is one
    for (int i = 0; i < 2 * count && start < 0; ++i) {
      if (cuts[i % count]) {
        if (quiet > gap) start = i % count;
        quiet = 0;
      } else {
        ++quiet;
      }
    }
    if (start < 0) return out.push_back(oriented({contour, true}));
    Polyline piece;
    quiet = 0;
    const auto finish = [&] {
      for (int k = 1; k < quiet && piece.size() > 1; ++k) piece.pop_back();
      const Polyline line = simplified(piece, kContourTolerance, false);
      if (line.size() > 1) out.push_back(oriented({line, false}));
      piece.clear();
    };
    // One sample before and after what cuts belongs to the piece, so that its ends are clean.
    for (int i = -1; i < count; ++i) {
      const int at = (start + i + count) % count;
      quiet = cuts[at] ? 0 : quiet + 1;
      if (cuts[at] && piece.empty()) piece.push_back(walk.at(total * (at - 1) / count));
      if (!piece.empty() || cuts[at]) piece.push_back(walk.at(total * at / count));
      if (quiet > gap && !piece.empty()) finish();
    }
    if (!piece.empty()) finish();
  }

  // Climb milling: what is to be removed lies to the right of the way.
  Piece oriented(Piece piece) const {
    const ArcLength<Vec2> walk(piece.line, piece.closed);
    const int count = std::clamp(static_cast<int>(walk.length()), 4, 60);
    const double aside = options_.cutter.ball_radius_mm * 0.8;
    int right = 0, left = 0;
    for (int i = 0; i < count; ++i) {
      const double s = walk.length() * (i + 0.5) / count;
      const Vec2 p = walk.at(s);
      Vec2 along = walk.at(s + 0.05) - walk.at(s - 0.05);
      if (along.norm() < 1e-9) continue;
      along.normalize();
      const Vec2 to_right(along.y(), -along.x());
      const Vec2 r = p + aside * to_right, l = p - aside * to_right;
      right += stock_.rest_above(r.x(), r.y(), z_);
      left += stock_.rest_above(l.x(), l.y(), z_);
    }
    if (left > right) std::reverse(piece.line.begin(), piece.line.end());
    return piece;
  }

  static double nearest_start(const Piece& piece, const Vec3& from) {
    const Vec2 at(from.x(), from.y());
    if (!piece.closed) return (piece.line.front() - at).norm();
    double nearest = 1e300;
    for (const Vec2& p : piece.line) nearest = std::min(nearest, (p - at).norm());
    return nearest;
  }

  static void start_near(Piece& piece, const Vec3& from) {
    if (!piece.closed) return;
    const Vec2 at(from.x(), from.y());
    const auto nearest =
        std::min_element(piece.line.begin(), piece.line.end(), [&](const Vec2& a, const Vec2& b) {
          return (a - at).squaredNorm() < (b - at).squaredNorm();
        });
    std::rotate(piece.line.begin(), nearest, piece.line.end());
  }

  // A closed contour is best begun where least stands.
  void start_in_air(Piece& piece) const {
    size_t best = 0;
    double least = 1e300;
    for (size_t i = 0; i < piece.line.size(); ++i) {
      const double depth = stock_.loose_depth(tip(piece.line[i]));
      if (depth < least - 1e-9) {
        least = depth;
        best = i;
      }
    }
    std::rotate(piece.line.begin(), piece.line.begin() + static_cast<std::ptrdiff_t>(best),
                piece.line.end());
  }

  bool still_cuts(const Piece& piece) const {
    const ArcLength<Vec2> walk(piece.line, piece.closed);
    const int count = std::max(2, static_cast<int>(walk.length() / kSampleStep));
    for (int i = 0; i <= count; ++i) {
      if (stock_.rest_depth(tip(walk.at(walk.length() * i / count))) > 0.03) return true;
    }
    return false;
  }

  // Straight on at this height without lifting, when everything between is allowed.
  bool may_link(const Vec3& from, const Vec2& to) const {
    if (std::abs(from.z() - z_) > 1e-9) return false;
    const Vec2 a(from.x(), from.y());
    const int steps = std::max(1, static_cast<int>(std::ceil((to - a).norm() / 0.1)));
    for (int i = 0; i <= steps; ++i) {
      if (!allowed(a + (to - a) * (static_cast<double>(i) / steps))) return false;
    }
    return true;
  }

  void follow(Piece& piece, double distance, PathWriter& writer) const {
    if (writer.at_work() && distance < 2 * options_.stepover_mm + 0.2 &&
        may_link(writer.position(), piece.line.front())) {
      writer.cut_to(tip(piece.line.front()));
    } else {
      if (piece.closed) start_in_air(piece);
      std::vector<Vec3> tips;
      for (const Vec2& p : piece.line) tips.push_back(tip(p));
      if (!writer.enter(tips, piece.closed, kApproach)) return;
    }
    for (size_t i = 1; i < piece.line.size(); ++i) writer.cut_to(tip(piece.line[i]));
    if (piece.closed) writer.cut_to(tip(piece.line.front()));
  }

  const MillingOptions& options_;
  const TipFloor& floor_;
  BlockStock& stock_;
  Clearance clearance_;
  double z_;
};

}  // namespace

std::vector<Path> rough(const MillingOptions& options, const Surroundings& solids,
                        const std::function<bool()>& interrupted, BlockStock& stock) {
  std::vector<Path> paths;
  const BlockStock::Span span = stock.rest_span();
  if (span.empty) return paths;
  const TipFloor floor(solids, stock.grid().frame, options, options.allowance_mm);
  // Below the lowest rest by the ball's radius nothing is left that its side has not passed.
  const double lowest = span.low - options.cutter.ball_radius_mm;
  const int levels = static_cast<int>(std::ceil((span.high - lowest) / options.stepdown_mm));
  for (int k = 1; k <= levels && !interrupted(); ++k) {
    Level level(options, floor, stock, span.high - k * options.stepdown_mm);
    std::vector<Piece> pieces = level.contours();
    if (!pieces.empty()) level.cut(std::move(pieces), paths);
  }
  return paths;
}

}  // namespace reforge

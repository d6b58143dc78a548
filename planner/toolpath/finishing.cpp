#include "planner/toolpath/finishing.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "planner/toolpath/arc_length.h"
#include "planner/toolpath/level_region.h"

namespace reforge {
namespace {

constexpr double kSkin = 0.005;         // mm left everywhere: rounding and chords must not gouge
constexpr double kNear = 0.5;           // mm from a contact point to a sample that it serves
constexpr double kPassed = 0.4;         // mm from a contact point to a sample that it finishes
constexpr double kChord = 0.004;        // mm between a raster line and its chords
constexpr double kSampleStep = 0.25;    // mm along raster lines
constexpr double kContourPitch = 0.25;  // mm, grid of steep contours
constexpr double kSteepest = 0.22;      // cosine: raster down to here, contours beyond
constexpr double kShallowest = 0.30;    // cosine where contours end; both overlap
constexpr double kSafetyOfStep = 0.9;   // of the theoretical step
constexpr double kLinkReach = 1.2;      // mm: neighbouring passes are linked along the surface
constexpr double kLinkRise = 0.4;       // mm a link may climb or fall
constexpr double kClear = 0.3;          // mm above stock that counts as air
constexpr int kStepLevels = 3;          // raster spacings: full, half, quarter

using Line3 = std::vector<Vec3>;

class Finisher {
 public:
  Finisher(const MillingOptions& options, const Surroundings& solids,
           const std::vector<MachinedSample>& samples, const std::vector<char>& wanted,
           const std::function<bool()>& interrupted, BlockStock& stock, std::vector<char>& done)
      : options_(options),
        samples_(samples),
        wanted_(wanted),
        interrupted_(interrupted),
        frame_(stock.grid().frame),
        ball_(options.cutter.ball_radius_mm),
        step_(kSafetyOfStep * 2 * std::sqrt(2 * ball_ * options.scallop_mm)),
        floor_(solids, frame_, options, kSkin),
        clearance_(stock.standing(), options.cutter),
        index_(samples, kNear),
        stock_(stock),
        done_(done) {}

  void run(std::vector<Path>& paths) {
    measure();
    if (shallow_box_.isEmpty() && steep_box_.isEmpty()) return;
    PathWriter writer(stock_, clearance_, paths);
    std::vector<Line3> lines = raster();
    follow_all(std::move(lines), writer);
    follow_contours(contours(), writer);
  }

 private:
  struct Contour {
    Line3 line;
    bool closed;
    Vec3 away;  // from the wall at the first point, horizontal
  };

  // Where the ball's tip is when it touches a sample.
  Vec3 tip_at(const MachinedSample& s) const {
    return frame_.to_local(s.point + ball_ * s.normal) - Vec3(0, 0, ball_);
  }

  void measure() {
    for (size_t i = 0; i < samples_.size(); ++i) {
      if (!wanted_[i]) continue;
      const double cosine = samples_[i].normal.dot(frame_.d);
      if (cosine > kSteepest - 0.02) shallow_box_.extend(tip_at(samples_[i]));
      if (cosine < kShallowest) steep_box_.extend(tip_at(samples_[i]));
    }
  }

  bool serves(const Vec3& contact_local, const Vec3& normal_local) const {
    bool found = false;
    index_.near(frame_.to_part(contact_local), frame_.to_part(normal_local),
                [&](int i) { found = found || wanted_[i]; });
    return found;
  }

  // The tip resting on V_R at (u, v), if finishing may stand there.
  struct Rest {
    Vec3 tip;
    Vec3 normal;
    bool serves = false;
  };
  std::optional<Rest> rest_at(double u, double v) const {
    const OffsetSurface::Contact contact = floor_.part().contact(u, v);
    if (!contact.exists()) return std::nullopt;
    const double w = contact.centre - ball_;
    if (!floor_.allows(u, v, w + 1e-9) || clearance_.holder_floor(u, v) > w) return std::nullopt;
    Rest rest{{u, v, w}, contact.normal, false};
    if (stock_.loose_depth(rest.tip) > ball_) return std::nullopt;
    rest.serves =
        serves(Vec3(u, v, contact.centre) - (ball_ + kSkin) * contact.normal, contact.normal);
    return rest;
  }

  // Raster lines run along u; line j stands at v_low + j * finest step. A line of level L is worth
  // its way where the surface falls so steeply across the lines that those of lower levels stand
  // too far apart.
  std::vector<Line3> raster() {
    std::vector<Line3> lines;
    if (shallow_box_.isEmpty()) return lines;
    const double finest = step_ / (1 << (kStepLevels - 1));
    const Vec3 low = shallow_box_.min() - Vec3(kNear, kNear, 0);
    const Vec3 high = shallow_box_.max() + Vec3(kNear, kNear, 0);
    const auto coarse_index = [&](double v) { return std::floor(v / step_); };
    const double v_low = coarse_index(low.y()) * step_;
    const int count = static_cast<int>(std::ceil((high.y() - v_low) / finest)) + 1;
    for (int j = 0; j < count && !interrupted_(); ++j) {
      int level = 0;
      while (level < kStepLevels - 1 && j % (1 << (kStepLevels - 1 - level)) != 0) ++level;
      raster_line(v_low + j * finest, low.x(), high.x(), level, lines);
    }
    return lines;
  }

  bool worth(const Rest& rest, int level) const {
    if (!rest.serves || rest.normal.z() < kSteepest) return false;
    if (level == 0) return true;
    const double across = rest.normal.y() / rest.normal.z();
    const double spread = std::sqrt(1 + across * across) * kSafetyOfStep;
    return spread > (1 << (level - 1));
  }

  void raster_line(double v, double u_low, double u_high, int level, std::vector<Line3>& lines) {
    const int steps = static_cast<int>(std::ceil((u_high - u_low) / kSampleStep));
    Line3 run;
    const auto finish = [&] {
      if (run.size() > 1) lines.push_back(simplified3(run));
      run.clear();
    };
    for (int i = 0; i <= steps; ++i) {
      const double u = u_low + (u_high - u_low) * i / steps;
      const std::optional<Rest> rest = rest_at(u, v);
      if (!rest || !worth(*rest, level)) {
        finish();
        continue;
      }
      if (!run.empty()) {
        if (std::abs(rest->tip.z() - run.back().z()) > 5 * kSampleStep ||
            !refine(run.back(), rest->tip, run)) {
          finish();
        }
      }
      run.push_back(rest->tip);
    }
    finish();
  }

  // Appends the points needed between a and b so that chords stay near the surface; false when the
  // surface between them cannot be passed.
  bool refine(const Vec3& a, const Vec3& b, Line3& out) const {
    if ((b - a).head<2>().norm() < 0.01) return true;
    const Vec3 middle = (a + b) / 2;
    const std::optional<Rest> rest = rest_at(middle.x(), middle.y());
    if (!rest) return false;
    if (std::abs(rest->tip.z() - middle.z()) < kChord) return true;
    const Vec3 from = a;  // `a` may live in `out`
    if (!refine(from, rest->tip, out)) return false;
    out.push_back(rest->tip);
    return refine(rest->tip, b, out);
  }

  static Line3 simplified3(const Line3& line) {
    // A raster line is plane: (u, w) is all of it.
    Polyline flat;
    for (const Vec3& p : line) flat.emplace_back(p.x(), p.z());
    Line3 out;
    for (const Vec2& p : simplified(flat, kChord, false))
      out.emplace_back(p.x(), line.front().y(), p.y());
    return out;
  }

  void follow_all(std::vector<Line3> lines, PathWriter& writer) {
    std::vector<char> used(lines.size(), 0);
    for (size_t n = 0; n < lines.size() && !interrupted_(); ++n) {
      size_t next = lines.size();
      double nearest = 1e300;
      bool turned = false;
      for (size_t i = 0; i < lines.size(); ++i) {
        if (used[i]) continue;
        if (!writer.at_work()) {
          next = i;
          break;
        }
        const double forward = (lines[i].front() - writer.position()).squaredNorm();
        const double backward = (lines[i].back() - writer.position()).squaredNorm();
        if (std::min(forward, backward) < nearest) {
          nearest = std::min(forward, backward);
          next = i;
          turned = backward < forward;
        }
      }
      used[next] = 1;
      Line3& line = lines[next];
      if (turned) std::reverse(line.begin(), line.end());
      if (!(writer.at_work() && link(writer, line.front())) && !writer.enter(line, false, kClear))
        continue;
      pass(line, false, writer);
    }
  }

  // Along the surface to a near start.
  bool link(PathWriter& writer, const Vec3& to) const {
    const Vec3 from = writer.position();
    if ((to - from).norm() > kLinkReach) return false;
    const int steps = std::max(2, static_cast<int>(std::ceil((to - from).head<2>().norm() / 0.1)));
    Line3 between;
    double low = std::min(from.z(), to.z()), high = std::max(from.z(), to.z());
    for (int i = 1; i < steps; ++i) {
      const Vec3 p = from + (to - from) * (static_cast<double>(i) / steps);
      const std::optional<Rest> rest = rest_at(p.x(), p.y());
      if (!rest) return false;
      between.push_back(rest->tip);
      low = std::min(low, rest->tip.z());
      high = std::max(high, rest->tip.z());
    }
    if (high - low > kLinkRise + std::abs(to.z() - from.z())) return false;
    for (const Vec3& p : between) writer.cut_to(p);
    writer.cut_to(to);
    return true;
  }

  void pass(const Line3& line, bool closed, PathWriter& writer) {
    for (size_t i = 0; i < line.size(); ++i) writer.cut_to(line[i]);
    if (closed) writer.cut_to(line.front());
    // Tick off what the ball touched.
    const size_t pieces = closed ? line.size() : line.size() - 1;
    for (size_t i = 0; i < pieces; ++i) {
      const Vec3 &a = line[i], &b = line[(i + 1) % line.size()];
      const int steps = std::max(1, static_cast<int>(std::ceil((b - a).norm() / kSampleStep)));
      for (int k = 0; k <= steps; ++k) touch(a + (b - a) * (static_cast<double>(k) / steps));
    }
  }

  // Marks the samples that a ball with its tip here touches: those at its surface.
  void touch(const Vec3& tip) {
    const Vec3 centre = frame_.to_part(tip + Vec3(0, 0, ball_));
    const OffsetSurface::Contact contact = floor_.part().contact(tip.x(), tip.y());
    const auto mark = [&](const Vec3& normal) {
      index_.near(centre - ball_ * normal, normal, [&](int i) {
        const MachinedSample& s = samples_[i];
        const double gap = (s.point - centre).norm() - ball_;
        if (gap < 0.08 && (s.point - (centre - ball_ * normal)).norm() < kPassed) done_[i] = 1;
      });
    };
    if (contact.exists() && contact.centre - ball_ > tip.z() - 0.05) {
      mark(frame_.to_part(contact.normal));
    }
    if (const std::optional<Vec3> wall = wall_normal(tip)) mark(frame_.to_part(*wall));
  }

  // The normal of a steep wall that the ball touches sideways, if any: just beyond, the ball would
  // rise.
  std::optional<Vec3> wall_normal(const Vec3& tip) const {
    std::optional<Vec3> best;
    for (int k = 0; k < 16; ++k) {
      const double angle = 2 * std::numbers::pi * k / 16;
      const Vec2 p(tip.x() + 0.02 * std::cos(angle), tip.y() + 0.02 * std::sin(angle));
      if (!floor_.part().is_above(p.x(), p.y(), tip.z() + ball_)) continue;
      const OffsetSurface::Contact contact = floor_.part().contact(p.x(), p.y());
      if (contact.centre - ball_ <= tip.z() || contact.normal.z() > kShallowest + 0.05) continue;
      // An edge above touches only its own side of the ball; the wall below it is plumb.
      if (!best || contact.normal.z() < best->z()) best = contact.normal;
    }
    return best;
  }

  // From the top down; below a contour that was followed, its neighbour comes next.
  void follow_contours(std::vector<Contour> contours, PathWriter& writer) {
    std::vector<char> used(contours.size(), 0);
    size_t from = contours.size();
    for (size_t n = 0; n < contours.size() && !interrupted_(); ++n) {
      size_t next = contours.size();
      for (size_t i = 0; i < contours.size() && next == contours.size(); ++i) {
        if (!used[i] && from < contours.size() && is_below(contours[i], contours[from])) next = i;
      }
      const bool chained = next < contours.size();
      for (size_t i = 0; i < contours.size() && next == contours.size(); ++i) {
        if (!used[i]) next = i;
      }
      used[next] = 1;
      const Contour& contour = contours[next];
      from = contours.size();
      if (!(chained && sink(contour, writer)) && !enter_sideways(contour, writer) &&
          !writer.enter(contour.line, contour.closed, kClear)) {
        continue;
      }
      pass(contour.line, contour.closed, writer);
      from = next;
    }
  }

  bool is_below(const Contour& c, const Contour& above) const {
    const double fall = above.line.front().z() - c.line.front().z();
    const Vec3& end = above.closed ? above.line.front() : above.line.back();
    return fall > 0 && fall < step_ + 1e-9 && (c.line.front() - end).head<2>().norm() < kLinkReach;
  }

  // Down to a contour just below without lifting: over to it at the present height, then sloping
  // along it.
  bool sink(const Contour& contour, PathWriter& writer) const {
    const Vec3 here = writer.position();
    const double rise = here.z() - contour.line.front().z();
    const ArcLength<Vec3> walk(contour.line, contour.closed);
    if (walk.length() < 2) return false;
    const double run = std::min(rise / 0.1, 4 * walk.length());
    const int steps = static_cast<int>(std::ceil(run / kSampleStep));
    Line3 ramp;
    for (int i = steps; i >= 0; --i) {
      ramp.push_back(walk.before_start(run * i / steps) + Vec3(0, 0, rise * i / steps));
    }
    const int checks = static_cast<int>(std::ceil((ramp.front() - here).norm() / 0.05)) + 1;
    for (int i = 0; i <= checks; ++i) {
      const Vec3 p = here + (ramp.front() - here) * (static_cast<double>(i) / checks);
      if (!free_at(p)) return false;
    }
    for (const Vec3& p : ramp) {
      if (!free_at(p)) return false;
    }
    for (const Vec3& p : ramp) writer.cut_to(p);
    return true;
  }

  bool free_at(const Vec3& tip) const {
    return floor_.allows(tip.x(), tip.y(), tip.z()) &&
           clearance_.holder_floor(tip.x(), tip.y()) <= tip.z();
  }

  // Comes down in the air beside the wall and moves in at depth.
  bool enter_sideways(const Contour& contour, PathWriter& writer) const {
    const Vec3 start = contour.line.front();
    for (const double aside : {0.8, 1.6, 2.4}) {
      const Vec3 beside = start + aside * contour.away;
      if (!free_at(beside) || stock_.loose_depth(beside) > -kClear) continue;
      bool open = true;
      for (double t = 0.1; t < aside && open; t += 0.1) open = free_at(start + t * contour.away);
      if (!open) continue;
      if (!writer.enter({beside, start}, false, 0.9 * kClear)) return false;
      return true;
    }
    return false;
  }

  std::vector<Contour> contours() {
    std::vector<Contour> out;
    if (steep_box_.isEmpty()) return out;
    const double step = step_;
    const int levels = static_cast<int>(std::ceil(steep_box_.sizes().z() / step)) + 1;
    for (int k = 0; k < levels && !interrupted_(); ++k) {
      contours_at(steep_box_.max().z() - k * step, step, out);
    }
    return out;
  }

  void contours_at(double z, double step, std::vector<Contour>& out) {
    Box3 box;
    for (size_t i = 0; i < samples_.size(); ++i) {
      if (!is_steep_at(i, z, step)) continue;
      const Vec3 tip = tip_at(samples_[i]);
      box.extend(Vec3(tip.x(), tip.y(), 0));
    }
    if (box.isEmpty()) return;
    const double reach = 1.0;
    const PlaneGrid grid =
        PlaneGrid::covering(box.min().head<2>() - Vec2(reach, reach),
                            box.max().head<2>() + Vec2(reach, reach), kContourPitch);
    std::vector<char> near(grid.size(), 0), nodes(grid.size(), 0);
    const int spread = static_cast<int>(std::ceil(reach / grid.pitch));
    for (size_t i = 0; i < samples_.size(); ++i) {
      if (!is_steep_at(i, z, step)) continue;
      const Vec3 tip = tip_at(samples_[i]);
      const int c = static_cast<int>(std::lround((tip.x() - grid.origin.x()) / grid.pitch));
      const int r = static_cast<int>(std::lround((tip.y() - grid.origin.y()) / grid.pitch));
      for (int row = std::max(0, r - spread); row <= std::min(grid.rows - 1, r + spread); ++row) {
        for (int col = std::max(0, c - spread); col <= std::min(grid.columns - 1, c + spread);
             ++col) {
          near[grid.index(col, row)] = 1;
        }
      }
    }
    const auto allowed = [&](const Vec2& p) {
      return clearance_.holder_floor(p.x(), p.y()) <= z && floor_.allows(p.x(), p.y(), z);
    };
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        const size_t i = grid.index(c, r);
        nodes[i] = near[i] && allowed(grid.node(c, r));
      }
    }
    const PlaneRegion region = region_where(grid, nodes, allowed);
    for (const Polyline& ring : region.rings) wanted_parts(ring, z, out);
  }

  bool is_steep_at(size_t i, double z, double step) const {
    if (!wanted_[i]) return false;
    const double cosine = samples_[i].normal.dot(frame_.d);
    return cosine < kShallowest && std::abs(tip_at(samples_[i]).z() - z) < step + 0.3;
  }

  void wanted_parts(const Polyline& ring, double z, std::vector<Contour>& out) {
    const int n = static_cast<int>(ring.size());
    std::vector<char> keep(n, 0);
    int kept = 0;
    for (int i = 0; i < n; ++i) {
      const Vec3 tip(ring[i].x(), ring[i].y(), z);
      if (stock_.loose_depth(tip) > 4 * ball_) continue;
      const std::optional<Vec3> wall = wall_normal(tip);
      if (!wall) continue;
      keep[i] = serves(tip + Vec3(0, 0, ball_) - (ball_ + kSkin) * *wall, *wall);
      kept += keep[i];
    }
    if (kept == 0) return;
    const auto add = [&](const Polyline& part, bool closed) {
      Contour contour{{}, closed, Vec3::Zero()};
      for (const Vec2& p : simplified(part, kChord, closed))
        contour.line.emplace_back(p.x(), p.y(), z);
      if (contour.line.size() < 2) return;
      if (const std::optional<Vec3> wall = wall_normal(contour.line.front())) {
        contour.away = Vec3(wall->x(), wall->y(), 0).normalized();
      }
      out.push_back(std::move(contour));
    };
    if (kept == n) return add(ring, true);
    int start = 0;
    while (keep[start] || !keep[(start + 1) % n]) start = (start + 1) % n;
    Polyline part;
    for (int k = 1; k <= n; ++k) {
      const int i = (start + k) % n;
      if (keep[i]) {
        part.push_back(ring[i]);
      } else if (!part.empty()) {
        add(part, false);
        part.clear();
      }
    }
    if (!part.empty()) add(part, false);
  }

  const MillingOptions& options_;
  const std::vector<MachinedSample>& samples_;
  const std::vector<char>& wanted_;
  const std::function<bool()>& interrupted_;
  const Frame frame_;
  const double ball_;
  const double step_;
  const TipFloor floor_;
  const Clearance clearance_;
  const SampleIndex index_;
  BlockStock& stock_;
  std::vector<char>& done_;
  Box3 shallow_box_, steep_box_;  // of the tips at wanted samples
};

}  // namespace

void finish(const MillingOptions& options, const Surroundings& solids,
            const std::vector<MachinedSample>& samples, const std::vector<char>& wanted,
            const std::function<bool()>& interrupted, BlockStock& stock, std::vector<char>& done,
            std::vector<Path>& paths) {
  Finisher(options, solids, samples, wanted, interrupted, stock, done).run(paths);
}

bool touchable(const MachinedSample& sample, const Frame& frame, const TipFloor& floor,
               const Clearance& obstacles, double ball_radius_mm) {
  const Vec3 tip =
      frame.to_local(sample.point + ball_radius_mm * sample.normal) - Vec3(0, 0, ball_radius_mm);
  if (sample.normal.dot(frame.d) < -0.02) return false;
  constexpr double kTolerance =
      0.03;  // mm: facets round a corner that the sample's own facet does not
  return obstacles.holder_floor(tip.x(), tip.y()) <= tip.z() &&
         floor.allows(tip.x(), tip.y(), tip.z() + kTolerance);
}

}  // namespace reforge

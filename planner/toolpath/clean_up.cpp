#include "planner/toolpath/clean_up.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "planner/toolpath/region.h"

namespace reforge {
namespace {

constexpr double kSkin = 0.01;      // mm left everywhere: rounding and chords must not gouge
constexpr double kChord = 0.005;    // mm between a line and its chords
constexpr double kStep = 0.15;      // mm along lines
constexpr double kWorth = 0.1;      // mm that the ball stands in rest: less is left to finishing
constexpr double kSteepest = 5;     // rise over run of a line
constexpr double kFinest = 0.01;    // mm between points of a line where it bends
constexpr double kGap = 1.0;        // mm through which a line goes on without cutting
constexpr double kRunIn = 0.6;      // mm of line before and after what it cuts
constexpr double kClear = 0.3;      // mm above stock that counts as air
constexpr double kLinkReach = 1.0;  // mm: neighbouring lines are linked along the surface

using Line = std::vector<Vec3>;

class CleanUp {
 public:
  CleanUp(const MillingOptions& options, const Surroundings& solids, BlockStock& stock)
      : ball_(options.cutter.ball_radius_mm),
        cutter_(options.cutter),
        floor_(solids, stock.grid().frame, options, kSkin),
        stock_(stock),
        lowest_{std::vector<double>(places(stock.grid()), kUnknown),
                std::vector<double>(places(stock.grid()), kUnknown)} {}

  void level(double height, std::vector<Path>& paths) {
    height_ = height;
    const Clearance clearance(stock_.standing(), cutter_);
    clearance_ = &clearance;
    PathWriter writer(stock_, clearance, paths);
    for (const bool along_v : {false, true}) {
      along_v_ = along_v;
      follow_rows(writer);
    }
    clearance_ = nullptr;
  }

 private:
  static constexpr int kPerCell = 2;  // places on a line for each cell of the stock's grid
  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

  static size_t places(const HeightGrid& grid) {
    return static_cast<size_t>(grid.columns) * static_cast<size_t>(grid.rows) * kPerCell;
  }

  // Rows are those of the grid, or its columns when lines run along v.
  int rows() const { return along_v_ ? stock_.grid().columns : stock_.grid().rows; }
  int row_places() const {
    return (along_v_ ? stock_.grid().rows : stock_.grid().columns) * kPerCell;
  }
  Vec2 place(int i, int row) const {
    const HeightGrid& grid = stock_.grid();
    const double along = i * grid.pitch_mm / kPerCell, across = row * grid.pitch_mm;
    return Vec2(grid.u0, grid.v0) + (along_v_ ? Vec2(across, along) : Vec2(along, across));
  }

  void follow_rows(PathWriter& writer) {
    bool forward = true;
    for (int row = 0; row < rows(); ++row) {
      std::vector<Line> lines = lines_of(row);
      if (lines.empty()) continue;
      if (!forward) {
        std::reverse(lines.begin(), lines.end());
        for (Line& line : lines) std::reverse(line.begin(), line.end());
      }
      forward = !forward;
      for (const Line& line : lines) {
        if (!(writer.at_work() && link(writer, line.front())) &&
            !writer.enter(line, false, kClear)) {
          continue;
        }
        for (const Vec3& tip : line) writer.cut_to(tip);
      }
    }
  }

  // The tip on this level, if it may be there.
  std::optional<Vec3> tip_over(double u, double v, double floor) const {
    const double w = std::max({height_, floor, clearance_->holder_floor(u, v)});
    if (!std::isfinite(w)) return std::nullopt;
    return Vec3(u, v, w);
  }
  std::optional<Vec3> tip_over(double u, double v) const { return tip_over(u, v, floor_(u, v)); }

  // The floor at places that lines pass on every level.
  double floor_at(int i, int row) {
    double& known = lowest_[along_v_][static_cast<size_t>(row) * row_places() + i];
    const Vec2 p = place(i, row);
    if (std::isnan(known)) known = floor_(p.x(), p.y());
    return known;
  }

  // Stretches of a row of the grid on which the ball would take rest away.
  std::vector<Line> lines_of(int row) {
    const int count = row_places();
    const double step = stock_.grid().pitch_mm / kPerCell;
    const int gap = static_cast<int>(kGap / step), run_in = static_cast<int>(kRunIn / step);
    std::vector<Line> lines;
    int from = -1, to = -1;  // the first and the last place of a stretch that cut
    const auto finish = [&] {
      if (from >= 0)
        add_lines(std::max(0, from - run_in), std::min(count - 1, to + run_in), row, lines);
      from = -1;
    };
    for (int i = 0; i < count; ++i) {
      if (from >= 0 && i - to > gap) finish();
      // On the level itself the ball stands deepest.
      const Vec2 p = place(i, row);
      if (stock_.rest_depth({p.x(), p.y(), height_}) < kWorth) continue;
      const std::optional<Vec3> tip = tip_over(p.x(), p.y(), floor_at(i, row));
      if (!tip) continue;
      const double depth = stock_.rest_depth(*tip);
      if (depth < kWorth || depth > ball_) continue;
      if (from < 0) from = i;
      to = i;
    }
    finish();
    return lines;
  }

  // Places [from, to] of a row as lines, broken where the ball may not stand or would climb a wall.
  void add_lines(int from, int to, int row, std::vector<Line>& lines) {
    Line line;
    const auto finish = [&] {
      Polyline flat;  // a line is plane: its run along u or v and w are all of it
      const int run = along_v_ ? 1 : 0;
      for (const Vec3& p : line) flat.emplace_back(p[run], p.z());
      const Vec2 side = place(0, row);
      line.clear();
      if (flat.size() < 2) return;
      Line out;
      for (const Vec2& p : simplified(flat, kChord / 2, false)) {
        Vec3 tip(side.x(), side.y(), p.y());
        tip[run] = p.x();
        out.push_back(tip);
      }
      lines.push_back(std::move(out));
    };
    for (int i = from; i <= to; ++i) {
      const Vec2 place_here = place(i, row);
      const std::optional<Vec3> tip = tip_over(place_here.x(), place_here.y(), floor_at(i, row));
      if (!tip || stock_.loose_depth(*tip) > ball_) {
        finish();
        continue;
      }
      if (!line.empty()) {
        const Vec3 before = line.back();
        if (std::abs(tip->z() - before.z()) > kSteepest * kStep || !refine(before, *tip, line))
          finish();
      }
      line.push_back(*tip);
    }
    finish();
  }

  // Appends the points needed between a and b so that chords stay near the surface; false where
  // the ball may not pass.
  bool refine(const Vec3& a, const Vec3& b, Line& out) const {
    if ((b - a).head<2>().norm() < kFinest) return true;
    const Vec3 middle = (a + b) / 2;
    const std::optional<Vec3> tip = tip_over(middle.x(), middle.y());
    if (!tip) return false;
    if (std::abs(tip->z() - middle.z()) < kChord / 2) return true;
    if (!refine(a, *tip, out)) return false;
    out.push_back(*tip);
    return refine(*tip, b, out);
  }

  // Along the surface to a near start.
  bool link(PathWriter& writer, const Vec3& to) const {
    const Vec3 from = writer.position();
    if ((to - from).norm() > kLinkReach) return false;
    const int steps = static_cast<int>(std::ceil((to - from).head<2>().norm() / kStep)) + 1;
    Line between;
    for (int i = 0; i <= steps; ++i) {
      const Vec3 p = from + (to - from) * (static_cast<double>(i) / steps);
      const std::optional<Vec3> tip = tip_over(p.x(), p.y());
      if (!tip || stock_.loose_depth(*tip) > ball_) return false;
      if (between.empty() && (*tip - from).norm() > kChord) return false;
      if (!between.empty() && (std::abs(tip->z() - between.back().z()) > kSteepest * kStep ||
                               !refine(Vec3(between.back()), *tip, between))) {
        return false;
      }
      between.push_back(*tip);
    }
    for (const Vec3& p : between) writer.cut_to(p);
    return true;
  }

  const double ball_;
  const Cutter& cutter_;
  const TipFloor floor_;
  BlockStock& stock_;
  const Clearance* clearance_ = nullptr;  // of the level
  double height_ = 0;
  bool along_v_ = false;
  std::array<std::vector<double>, 2> lowest_;  // along u, v; by row and place; NaN: not asked yet
};

}  // namespace

void clean_up(const MillingOptions& options, const Surroundings& solids,
              const std::function<bool()>& interrupted, BlockStock& stock,
              std::vector<Path>& paths) {
  const BlockStock::Span span = stock.rest_span();
  if (span.empty) return;
  CleanUp work(options, solids, stock);
  const double lowest = span.low - options.cutter.ball_radius_mm;
  const int levels = static_cast<int>(std::ceil((span.high - lowest) / options.stepdown_mm));
  for (int k = 1; k <= levels && !interrupted(); ++k) {
    work.level(span.high - k * options.stepdown_mm, paths);
  }
}

}  // namespace reforge

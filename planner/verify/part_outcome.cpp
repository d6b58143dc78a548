#include "planner/verify/part_outcome.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace reforge::verify {
namespace {

constexpr double kSamplePitch = 0.25;  // mm
constexpr double kFar = 3.0;           // mm
constexpr double kSameSurface = 0.02;  // mm along the normal
constexpr double kEdge = 0.5;          // mm around another kind's surface
constexpr double kMissing = 0.15;      // mm
constexpr double kFacing = 0.5735;     // cosine of 55 degrees
constexpr double kCoverPitch = 0.4;    // mm
constexpr double kCoverHeight = 0.3;   // mm: a layer and a half

Intervals both(const Material& material, std::size_t cell) {
  const auto original = material.original.at(cell);
  Intervals all(original.begin(), original.end());
  for (const Interval& s : material.deposited.at(cell)) unite(all, s, 1e-3f);
  return all;
}

// Distance along w from the target's surface at `w` to the nearest surface of the part that faces
// the same way; positive where the part is larger.
double along_w(std::span<const Interval> part, double w, bool upper) {
  double best = std::numeric_limits<double>::infinity();
  bool inside = false;  // the part, just below the target's surface
  const double probe = upper ? w - 0.05 : w + 0.05;
  for (const Interval& s : part) {
    const double surface = static_cast<double>(upper ? s.hi : s.lo);
    const double difference = upper ? surface - w : w - surface;
    if (std::fabs(difference) < std::fabs(best)) best = difference;
    inside = inside || (probe > static_cast<double>(s.lo) && probe < static_cast<double>(s.hi));
  }
  if (std::fabs(best) <= kFar) return best;
  return inside ? kFar : -kFar;
}

enum class Kind : std::uint8_t { kMilled, kKept, kPrinted };

// Whether a column's surface passes within `reach` of w, facing the same way.
bool bounds(std::span<const Interval> solid, double w, bool upper, double reach) {
  for (const Interval& s : solid) {
    if (std::fabs(static_cast<double>(upper ? s.hi : s.lo) - w) <= reach) return true;
  }
  return false;
}

struct Judged {
  Kind kind;
  double deviation;
  double area;
  Vec3 where;
};

class SurfaceJudge {
 public:
  SurfaceJudge(const Stock& stock, const PartReference& reference, double pitch)
      : stock_(stock), reference_(reference), pitch_(std::max(pitch, kSamplePitch)) {}

  std::vector<Judged> run() {
    for (const Vec3& axis : {Vec3(Vec3::UnitX()), Vec3(Vec3::UnitY()), Vec3(Vec3::UnitZ())})
      along(axis);
    return std::move(judged_);
  }

 private:
  void along(const Vec3& axis) {
    std::vector<Vec3> points = reference_.target->vertices;
    points.insert(points.end(), reference_.initial->vertices.begin(),
                  reference_.initial->vertices.end());
    const View view = make_view(axis, points, 1.0, pitch_);
    const Material material = stock_.columns(view);
    const Columns initial = rasterise(*reference_.initial, view);
    const Columns reused = reference_.reused ? rasterise(*reference_.reused, view) : Columns();
    const std::vector<SurfaceSample> samples = sample_surface(*reference_.target, view);

    const auto kind_of = [&](const SurfaceSample& s) {
      const bool upper = s.cosine > 0;
      const double w = static_cast<double>(s.w);
      const bool of_initial = bounds(initial.at(s.cell), w, upper, kSameSurface);
      if (!reference_.reused) return of_initial ? Kind::kKept : Kind::kMilled;
      if (!bounds(reused.at(s.cell), w, upper, kSameSurface)) return Kind::kPrinted;
      return of_initial ? Kind::kKept : Kind::kMilled;
    };
    // Kinds met in each cell and its neighbours within kEdge, at similar heights.
    std::vector<std::vector<std::pair<float, Kind>>> met(view.cells());
    std::vector<Kind> kinds;
    kinds.reserve(samples.size());
    for (const SurfaceSample& s : samples) {
      kinds.push_back(kind_of(s));
      met[s.cell].push_back({s.w, kinds.back()});
    }
    const int reach = static_cast<int>(std::ceil(kEdge / pitch_));
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const SurfaceSample& s = samples[k];
      const double facing = std::fabs(static_cast<double>(s.cosine));
      if (facing < kFacing) continue;
      const int i = static_cast<int>(s.cell) % view.nu;
      const int j = static_cast<int>(s.cell) / view.nu;
      if (mixed(view, met, i, j, reach, s.w, kinds[k])) continue;
      const double along = along_w(both(material, s.cell), static_cast<double>(s.w), s.cosine > 0);
      const Vec3 where = view.to_part(Vec3(view.u(i), view.v(j), static_cast<double>(s.w)));
      // Up to three axes see a point of the surface; their cosines' squares sum to one.
      judged_.push_back({kinds[k], along * facing, pitch_ * pitch_ * facing, where});
    }
  }

  static bool mixed(const View& view, const std::vector<std::vector<std::pair<float, Kind>>>& met,
                    int i, int j, int reach, float w, Kind kind) {
    for (int b = std::max(0, j - reach); b <= std::min(view.nv - 1, j + reach); ++b) {
      for (int a = std::max(0, i - reach); a <= std::min(view.nu - 1, i + reach); ++a) {
        for (const auto& [height, other] : met[view.cell(a, b)]) {
          if (other != kind && std::fabs(height - w) < 2 * static_cast<float>(kEdge)) return true;
        }
      }
    }
    return false;
  }

  const Stock& stock_;
  const PartReference& reference_;
  double pitch_;
  std::vector<Judged> judged_;
};

std::optional<Deviation> summary(const std::vector<Judged>& judged, Kind kind) {
  Deviation d;
  std::vector<double> values;
  for (const Judged& s : judged) {
    if (s.kind != kind) continue;
    if (values.empty() || s.deviation < d.least) d.least = s.deviation, d.worst = s.where;
    values.push_back(s.deviation);
    if (s.deviation < -kMissing) d.missing_mm2 += s.area;
  }
  if (values.empty()) return std::nullopt;
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  d.samples = values.size();
  d.p01 = at(0.01), d.p05 = at(0.05), d.p50 = at(0.5), d.p95 = at(0.95), d.p99 = at(0.99);
  d.most = values.back();
  return d;
}

// The part of V_A that lies within an infill gap of a bead.
double covered(const Stock& stock, const PartReference& reference) {
  std::vector<Vec3> points = reference.added->vertices;
  points.insert(points.end(), reference.initial->vertices.begin(),
                reference.initial->vertices.end());
  const View view = make_view(Vec3::UnitZ(), points, 1.0, kCoverPitch);
  const Material material = stock.columns(view);
  const Columns planned = rasterise(*reference.added, view);
  const double radius = 0.5 * reference.infill_gap_mm + 0.5 * kCoverPitch;
  const int reach = static_cast<int>(std::floor(radius / kCoverPitch));
  double sum = 0;
  Intervals near, merged;
  for (int j = 0; j < view.nv; ++j) {
    for (int i = 0; i < view.nu; ++i) {
      const auto wanted = planned.at(view.cell(i, j));
      if (wanted.empty()) continue;
      near.clear();
      for (int b = std::max(0, j - reach); b <= std::min(view.nv - 1, j + reach); ++b) {
        for (int a = std::max(0, i - reach); a <= std::min(view.nu - 1, i + reach); ++a) {
          if (std::hypot(a - i, b - j) * kCoverPitch > radius) continue;
          for (Interval s : material.deposited.at(view.cell(a, b))) {
            s.lo -= static_cast<float>(kCoverHeight);
            s.hi += static_cast<float>(kCoverHeight);
            near.push_back(s);
          }
        }
      }
      std::sort(near.begin(), near.end(),
                [](const Interval& a, const Interval& b) { return a.lo < b.lo; });
      merged.clear();
      for (const Interval& s : near) {
        if (!merged.empty() && s.lo <= merged.back().hi) {
          merged.back().hi = std::max(merged.back().hi, s.hi);
        } else {
          merged.push_back(s);
        }
      }
      sum += shared_length(wanted, merged);
    }
  }
  return sum * kCoverPitch * kCoverPitch;
}

}  // namespace

PartOutcome judge_part(const Stock& stock, const PartReference& reference, double pitch) {
  PartOutcome outcome;
  std::vector<Vec3> points = reference.initial->vertices;
  if (reference.target) {
    points.insert(points.end(), reference.target->vertices.begin(),
                  reference.target->vertices.end());
  }
  if (points.empty()) return outcome;
  const View view = make_view(Vec3::UnitZ(), points, 2.0, pitch);
  {
    const Material material = stock.columns(view);
    const Columns reused = reference.reused ? rasterise(*reference.reused, view) : Columns();
    const Columns added = reference.added ? rasterise(*reference.added, view) : Columns();
    const double area = pitch * pitch;
    outcome.initial = rasterise(*reference.initial, view).length() * area;
    outcome.reused = material.original.length() * area;
    outcome.removed = outcome.initial - outcome.reused;
    double shared = 0, kept = 0, wanted = 0, in_plan = 0;
    for (std::size_t c = 0; c < view.cells(); ++c) {
      const auto original = material.original.at(c);
      const auto deposited = material.deposited.at(c);
      shared += shared_length(original, deposited);
      if (reference.reused) {
        kept += shared_length(original, reused.at(c));
        for (const Interval& s : reused.at(c)) wanted += static_cast<double>(s.hi - s.lo);
      }
      if (reference.added) in_plan += shared_length(deposited, added.at(c));
    }
    outcome.added = material.deposited.length() * area - shared * area;
    if (reference.reused) {
      outcome.kept_cut = (wanted - kept) * area;
      outcome.left_over = outcome.reused - kept * area;
    }
    outcome.added_in_plan = in_plan * area;
  }
  if (reference.added && !reference.added->empty())
    outcome.plan_covered = covered(stock, reference);
  if (reference.target && !reference.target->empty()) {
    const std::vector<Judged> judged = SurfaceJudge(stock, reference, pitch).run();
    outcome.milled = summary(judged, Kind::kMilled);
    outcome.kept = summary(judged, Kind::kKept);
    outcome.printed = summary(judged, Kind::kPrinted);
  }
  return outcome;
}

}  // namespace reforge::verify

#include "planner/reuse/accessibility.h"

#include <cmath>
#include <numbers>
#include <thread>

namespace reforge {
namespace {

constexpr double kBelowBase = 1e-6;  // mm of rounding allowed under z = 0

std::vector<Vec3> corners_of(std::span<const TriangleMesh* const> obstacles,
                             std::span<const Vec3> around) {
  std::vector<Vec3> points(around.begin(), around.end());
  for (const TriangleMesh* mesh : obstacles) {
    points.insert(points.end(), mesh->vertices.begin(), mesh->vertices.end());
  }
  return points;
}

HeightMap envelope_of(const Vec3& direction, std::span<const TriangleMesh* const> obstacles,
                      std::span<const Vec3> around, double margin, double pitch) {
  const auto points = corners_of(obstacles, around);
  HeightMap map(HeightGrid::over(Frame::along(direction), pitch, points, margin));
  for (const TriangleMesh* mesh : obstacles) raise_to(map, *mesh, Sampling::kCentres);
  return map;
}

}  // namespace

ToolBodies tool_bodies(const RigDescription& rig, Mode mode) {
  const CutterDescription cutter = mode == Mode::kPaper ? paper_cutter(rig.cutter) : rig.cutter;
  const NozzleDescription nozzle = mode == Mode::kPaper ? paper_nozzle(rig.nozzle) : rig.nozzle;
  return {cutter.diameter_mm / 2, cutter.holder, nozzle.body};
}

std::vector<Vec3> hemisphere_directions(int count) {
  std::vector<Vec3> directions{Vec3::UnitZ(), Vec3::UnitX(), -Vec3::UnitX(), Vec3::UnitY(),
                               -Vec3::UnitY()};
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  // From steep to level and again, so that the first few are spread as well.
  constexpr int kTurns = 7;
  for (int first = 0; first < kTurns; ++first) {
    for (int i = count - 1 - first; i >= 0; i -= kTurns) {
      const double z = (i + 0.5) / count, r = std::sqrt(1 - z * z), turn = golden * i;
      directions.emplace_back(r * std::cos(turn), r * std::sin(turn), z);
    }
  }
  return directions;
}

std::vector<Vec3> ball_centres(const SurfaceSample& sample, bool reused_goes,
                               double ball_radius_mm) {
  std::vector<Vec3> centres;
  const Frame frame = Frame::along(sample.normal);
  const bool either_side = !sample.borders_reused() || reused_goes;
  for (const double side : {1.0, -1.0}) {
    if (side < 0 && !either_side) break;
    const Vec3 centre = sample.position + side * ball_radius_mm * sample.normal;
    centres.push_back(centre);
    for (int k = 0; k < 8; ++k) {
      const double turn = k * std::numbers::pi / 4;
      centres.push_back(centre +
                        ball_radius_mm * (std::cos(turn) * frame.u + std::sin(turn) * frame.v));
    }
  }
  return centres;
}

DirectionalReach::DirectionalReach(const Vec3& direction,
                                   std::span<const TriangleMesh* const> obstacles,
                                   std::span<const Vec3> around, const ToolBodies& tools,
                                   double pitch_mm)
    : direction_(direction),
      ball_radius_(tools.ball_radius_mm),
      cutter_tips_(envelope_of(direction, obstacles, around, 2 * tools.ball_radius_mm, pitch_mm)),
      nozzle_tips_(cutter_tips_.grid) {
  const double narrowed = -0.71 * pitch_mm;
  nozzle_tips_ = tip_heights(cutter_tips_, tools.nozzle, narrowed);
  cutter_tips_ = tip_heights(cutter_tips_, tools.cutter, narrowed);
}

bool DirectionalReach::cutter_reaches(const Vec3& ball_centre) const {
  const Vec3 tip = ball_centre - ball_radius_ * direction_;
  return tip.z() >= -kBelowBase && cutter_tips_.lookup(ball_centre) <= tip.dot(direction_) + 1e-4;
}

bool DirectionalReach::nozzle_reaches(const Vec3& tip) const {
  return tip.z() >= -kBelowBase && nozzle_tips_.lookup(tip) <= tip.dot(direction_) + 1e-4;
}

bool is_beneath_base(const SurfaceSample& sample, double ball_radius_mm) {
  return sample.position.z() + ball_radius_mm * sample.normal.z() < 0;
}

ReachTable reach_of(const std::vector<SurfaceSample>& samples, const BitSet& cutter,
                    const BitSet& nozzle, const std::vector<Vec3>& directions,
                    std::span<const TriangleMesh* const> obstacles, const ToolBodies& tools,
                    double pitch_mm) {
  ReachTable table;
  table.cutter.assign(directions.size(), BitSet(samples.size()));
  table.nozzle = table.cutter;
  table.cutter_anywhere = table.nozzle_anywhere = BitSet(samples.size());
  std::vector<Vec3> around;
  BitSet to_serve = cutter;
  std::vector<std::vector<Vec3>> centres(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    around.push_back(samples[i].position);
    if (is_beneath_base(samples[i], tools.ball_radius_mm)) to_serve.clear(i);
    if (cutter.test(i)) centres[i] = ball_centres(samples[i], false, tools.ball_radius_mm);
  }
  const auto look = [&](std::size_t d) {
    const DirectionalReach reach(directions[d], obstacles, around, tools, pitch_mm);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      for (const Vec3& centre : centres[i]) {
        if (!reach.cutter_reaches(centre)) continue;
        table.cutter[d].set(i);
        break;
      }
      if (nozzle.test(i) && reach.nozzle_reaches(samples[i].position)) table.nozzle[d].set(i);
    }
  };
  // In rounds of a few directions, so that what is looked at does not depend on the threads.
  constexpr std::size_t kRound = 10;
  for (std::size_t from = 0; from < directions.size(); from += kRound) {
    const std::size_t to = std::min(directions.size(), from + kRound);
    std::thread other([&] {
      for (std::size_t d = from + 1; d < to; d += 2) look(d);
    });
    for (std::size_t d = from; d < to; d += 2) look(d);
    other.join();
    for (std::size_t d = from; d < to; ++d) {
      table.cutter_anywhere |= table.cutter[d];
      table.nozzle_anywhere |= table.nozzle[d];
    }
    BitSet left = to_serve;
    left.subtract(table.cutter_anywhere);
    if (!left.any() && table.nozzle_anywhere == nozzle) break;
  }
  return table;
}

bool body_holds(std::span<const ToolSection> sections, const Vec3& tip, const Vec3& direction,
                const Vec3& point) {
  const Vec3 from_tip = point - tip;
  const double height = from_tip.dot(direction);
  const double square = from_tip.squaredNorm() - height * height;
  double widest = 0;
  for (const ToolSection& section : sections) {
    if (height <= section.z_from_mm) break;
    widest = std::max(widest, section.r_from_mm);
    if (section.r_to_mm > section.r_from_mm) {
      const double part =
          std::min(1.0, (height - section.z_from_mm) / (section.z_to_mm - section.z_from_mm));
      widest = std::max(widest, section.r_from_mm + part * (section.r_to_mm - section.r_from_mm));
    }
  }
  return square < widest * widest;
}

}  // namespace reforge

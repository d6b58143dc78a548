#include "planner/program/rotary_choice.h"

#include <algorithm>
#include <cmath>

#include "planner/machine/tool.h"
#include "planner/program/program_writer.h"

namespace reforge {
namespace {

constexpr double kMapPitch = 1.0;
constexpr double kIdleGap = 0.5;     // mm kept below idle bodies
constexpr double kSampleStep = 2.0;  // mm along paths
constexpr double kSlack = 5e-4;      // mm: the program's decimals

Vec3 vec(const Point<MachineFrame>& p) {
  return {p.x, p.y, p.z};
}

// All tips of a block, at their ends and every kSampleStep between.
std::vector<Vec3> tips_of(const BlockToolpath& block) {
  std::vector<Vec3> tips;
  for (const Path& path : block.paths) {
    for (const Move& move : path.moves) {
      if (!tips.empty()) {
        const Vec3 from = tips.back();
        const int steps = static_cast<int>((move.to - from).norm() / kSampleStep);
        for (int k = 1; k < steps; ++k)
          tips.push_back(from + (move.to - from) * (static_cast<double>(k) / steps));
      }
      tips.push_back(move.to);
    }
  }
  return tips;
}

std::string beyond_travel(const RigDescription& rig, const BlockToolpath& block,
                          const RotaryAngles& angles, const std::vector<Vec3>& tips,
                          double safe_z) {
  const Vec3 shift = programmed_shift(rig, block.kind), g54 = vec(rig.kinematics.g54_in_machine_mm);
  Vec3 low = Vec3::Constant(1e300), high = Vec3::Constant(-1e300);
  for (const Vec3& tip : tips) {
    const Vec3 j =
        vec(to_machine(rig.kinematics, angles, part_point(block.frame.to_part(tip)))) + shift + g54;
    low = low.cwiseMin(j);
    high = high.cwiseMax(j);
  }
  high.z() = std::max(high.z(), safe_z + g54.z());
  const LinearAxis* axes[] = {&rig.x, &rig.y, &rig.z};
  for (int k = 0; k < 3; ++k) {
    const bool under = low[k]<axes[k]->min_mm - kSlack, over = high[k]> axes[k]->max_mm + kSlack;
    if (!under && !over) continue;
    return std::string(1, "XYZ"[k]) + " would go to " + number(under ? low[k] : high[k], 1) +
           " mm, beyond its travel of " + number(axes[k]->min_mm, 1) + " to " +
           number(axes[k]->max_mm, 1);
  }
  return "";
}

struct IdleBody {
  const char* name;
  std::vector<ToolSection> sections;
  Vec3 offset;  // its tip minus the active tip, machine frame
};

std::vector<IdleBody> idle_bodies(const RigDescription& rig, BlockKind kind) {
  if (kind == BlockKind::kMill) {
    return {{"parked nozzle", rig.nozzle.body, vec(rig.nozzle.parked_offset_mm)}};
  }
  std::vector<ToolSection> cutter = rig.cutter.holder;
  cutter.insert(cutter.begin(), {0, rig.cutter.flute_length_mm, rig.cutter.diameter_mm / 2,
                                 rig.cutter.diameter_mm / 2});
  return {{"idle cutter with its spindle", cutter, -vec(rig.nozzle.deployed_offset_mm)}};
}

std::string idle_collision(const RigDescription& rig,
                           const std::vector<const TriangleMesh*>& solids,
                           const BlockToolpath& block, const RotaryAngles& angles,
                           const std::vector<Vec3>& tips) {
  double highest = -1e300, lowest_tip = 1e300;
  std::vector<Vec3> points;
  for (const TriangleMesh* solid : solids) {
    points.insert(points.end(), solid->vertices.begin(), solid->vertices.end());
  }
  for (const Vec3& p : points) highest = std::max(highest, block.frame.d.dot(p));
  for (const Vec3& tip : tips) lowest_tip = std::min(lowest_tip, tip.z());
  const Eigen::Matrix3d to_part = part_to_machine_rotation(rig.kinematics, angles).transpose();
  for (const IdleBody& body : idle_bodies(rig, block.kind)) {
    const Vec3 offset = block.frame.to_local(to_part * body.offset);
    if (lowest_tip + offset.z() > highest + kIdleGap) continue;
    double widest = 0;
    for (const ToolSection& s : body.sections) widest = std::max({widest, s.r_from_mm, s.r_to_mm});
    HeightMap standing(HeightGrid::over(block.frame, kMapPitch, points, widest + 2 * kMapPitch));
    for (const TriangleMesh* solid : solids) raise_to(standing, *solid, Sampling::kConservative);
    const HeightMap floor = tip_heights(standing, body.sections, kMapPitch);
    for (const Vec3& tip : tips) {
      const Vec3 idle = tip + offset;
      if (floor.lookup(block.frame.to_part(idle)) + kIdleGap > idle.z()) {
        return std::string("the ") + body.name + " would meet the part, the table or the fixture";
      }
    }
  }
  return "";
}

}  // namespace

Vec3 programmed_shift(const RigDescription& rig, BlockKind kind) {
  return kind == BlockKind::kPrint ? Vec3(-vec(rig.nozzle.deployed_offset_mm)) : Vec3(Vec3::Zero());
}

std::optional<RotaryChoice> choose_angles(const RigDescription& rig, Mode mode,
                                          const std::vector<const TriangleMesh*>& solids,
                                          const BlockToolpath& block, double safe_z,
                                          const RotaryAngles& previous) {
  const std::vector<RotaryAngles> solutions = rotary_solutions(rig, block.frame.d, previous);
  if (solutions.empty()) return std::nullopt;
  const std::vector<Vec3> tips = tips_of(block);
  std::optional<RotaryChoice> first;
  for (const RotaryAngles& angles : solutions) {
    std::string objection = beyond_travel(rig, block, angles, tips, safe_z);
    if (objection.empty() && mode == Mode::kStrict) {
      objection = idle_collision(rig, solids, block, angles, tips);
    }
    if (objection.empty()) return RotaryChoice{angles, ""};
    if (!first) first = RotaryChoice{angles, objection};
  }
  return first;
}

}  // namespace reforge
